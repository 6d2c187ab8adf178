"""The inference problem of named points in calibrated cameras, each point by itself: geometry in pixels, inputs, first guesses.

The programs are those of ``poseppl_models.bodies.named_points``. They count lengths in pixels, from the
middle of the points. So priors suit a fly as well as a horse, in any unit of the calibration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from poseppl_models.bodies.named_points import points_in_cameras

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.motion.bodies.body import PointInputs, compile_once
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.geometry.recorded_frames import depths
from poseppl.program import CompiledModel, Observation

FREEDOM = 5.0
"""Degrees of freedom of a detector's errors that do not last; ours."""
MIN_SURE, MAX_SURE = 0.001, 0.999
"""Confidences outside are taken for these: detectors say 0 and 1, and mean neither."""
START_SCALE = 3.0
"""Standard deviation of the first positions, in the extent of all."""


class PointRecording(NamedTuple):
    """Detections of K points in C cameras over T frames.

    Attributes:
        names: K names.
        camera_names: C names.
        cameras: C cameras.
        sizes: (C, 2) width and height of the pictures, px.
        points: (T, C, K, 2) px; NaN where a point was not found.
        confidence: (T, C, K).
        frames: (T,) ascending frame numbers.
        times: (T,) ascending, s.
        rate: Frames a second; None where unknown.
        source: Its files.
        notes: Notes for the user.
    """

    names: tuple[str, ...]
    camera_names: tuple[str, ...]
    cameras: Cameras
    sizes: Floats
    points: Floats
    confidence: Floats
    frames: Integers
    times: Floats
    rate: float | None
    source: str
    notes: tuple[str, ...] = ()

    def of_cameras(self, chosen: Sequence[int]) -> PointRecording:
        """The detections of some of the cameras."""
        index = np.asarray(chosen)
        return self._replace(
            camera_names=tuple(self.camera_names[c] for c in chosen),
            cameras=jax.tree.map(lambda leaf: leaf[index], self.cameras),
            sizes=self.sizes[index],
            points=self.points[:, index],
            confidence=self.confidence[:, index],
        )

    def of_frames(self, part: slice | Integers) -> PointRecording:
        """Some of the frames."""
        cut = {name: getattr(self, name)[part] for name in ("points", "confidence", "frames", "times")}
        return self._replace(**cut)


class LocalFrame(NamedTuple):
    """Coordinates in pixels at the points: (x - origin) * unit."""

    origin: Floats
    unit: float

    def to_world(self, places: Any) -> Floats:
        """Places (..., 3), mm, of local ones."""
        return np.asarray(np.asarray(places, np.float64) / self.unit + self.origin)

    def to_local(self, places: Floats) -> Floats:
        """Local places (..., 3) of those in mm."""
        return np.asarray((places - self.origin) * self.unit)

    def cameras(self, cameras: Cameras) -> Cameras:
        """Cameras in local coordinates, in double precision where that is on."""
        double: Cameras = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf, np.float64), float), cameras)
        return double._replace(centre=(double.centre - jnp.asarray(self.origin)) * self.unit)


BY_POINT = PointInputs(None, None, None, 0, None, None, 0, None, None, None, None)
"""Which of the inputs have a leading axis of points."""


class PointProblem(NamedTuple):
    """The problem of K points that know nothing of each other.

    Attributes:
        frame: Its coordinates.
        model: Model of a single point; its params are to be set.
        whole: Model of all points; its parameters program is the prior.
        observations: Data with leading axes K and T.
        inputs: With leading axes K, where :data:`BY_POINT` says so, and T.
        start: First guess (K, T, d) of the states.
    """

    frame: LocalFrame
    model: CompiledModel
    whole: CompiledModel
    observations: Observation
    inputs: PointInputs
    start: Array


def logits(confidence: Floats) -> Floats:
    """Logits of a detector's confidences; of a point that was not found, whatever: its data are masked."""
    sure = np.clip(np.nan_to_num(confidence, nan=MIN_SURE), MIN_SURE, MAX_SURE)
    return np.asarray(np.log(sure) - np.log1p(-sure))


def make_point_problem(recording: PointRecording) -> PointProblem:
    """Pose the problem of a recording; to be called, and used, in double precision.

    Raises:
        InputError: No point is seen by two cameras at a time.
    """
    places = triangulate(recording.cameras, recording.points, recording.confidence)
    frame, magnification = local_frame(recording, places)
    local = frame.to_local(filled(places, frame.origin))
    num_frames, num_points = local.shape[:2]
    num_cameras = len(recording.camera_names)

    def always(value: Any) -> Array:
        array = jnp.asarray(value, float)
        return jnp.broadcast_to(array, (num_frames, *array.shape))

    inputs = PointInputs(
        cameras=jax.tree.map(always, frame.cameras(recording.cameras)),
        magnification=always(magnification / frame.unit),
        window=always(recording.sizes),
        logit=jnp.asarray(np.moveaxis(logits(recording.confidence), 2, 0)[..., None]),
        elapsed=jnp.asarray(np.diff(recording.times, prepend=recording.times[:1] - 1.0), float),
        freedom=always(FREEDOM),
        start=jnp.broadcast_to(jnp.asarray(local[0])[:, None, None], (num_points, num_frames, 1, 3)),
        start_scale=always(START_SCALE * max(float(np.ptp(local, axis=(0, 1)).max()), 10.0)),
        **dict.fromkeys(("length", "length_scale", "tolerance"), jnp.zeros((num_frames, 0))),
    )
    first = jax.tree.map(lambda leaf: leaf[0], inputs)
    one = first._replace(logit=first.logit[0], start=first.start[0])
    all_points = one._replace(logit=inputs.logit[:, 0, :, 0].T, start=inputs.start[:, 0, 0])
    model = compile_once(points_in_cameras(1, num_cameras), one)
    whole = compile_once(points_in_cameras(num_points, num_cameras), all_points)
    data = np.moveaxis(recording.points, 2, 0)[:, :, :, None]
    seen = np.isfinite(data).all(-1, keepdims=True) & np.ones(2, bool)
    observations = Observation({"points": jnp.asarray(np.where(seen, data, 0.0))}, {"points": jnp.asarray(seen)})
    still = jax.vmap(model.to_sites)(jnp.zeros((num_frames, model.dimension)))
    motion = np.moveaxis(np.stack([local, np.zeros_like(local)], -1), 1, 0)[:, :, None]
    start = jax.vmap(lambda own: jax.vmap(model.to_flat)({**still, "motion": own}))(jnp.asarray(motion))
    return PointProblem(frame, model, whole, observations, inputs, start)


def places_of(model: CompiledModel, states: Array) -> Array:
    """Positions (..., K, 3) of flat states (..., d)."""
    flat = states.reshape(-1, states.shape[-1])
    motion = jax.vmap(model.to_sites)(flat)["motion"]
    places: Array = motion[..., 0].reshape(*states.shape[:-1], *motion.shape[1:-1])
    return places


def local_frame(recording: PointRecording, places: Floats) -> tuple[LocalFrame, Floats]:
    """Coordinates around the middle of the places, and pixels a mm (C,) of each camera there."""
    known = places[np.isfinite(places).all(-1)]
    if not len(known):
        raise InputError("no point is seen by two cameras at a time", field=Argument("files"), expected="two cameras' points")
    origin = np.median(known, 0)
    deep = depths(recording.cameras, origin)
    if np.any(deep <= 0):
        name = recording.camera_names[int(np.argmin(deep))]
        raise InputError(f"the points are behind {name}", field=Argument("calibration"), expected="cameras that face them")
    magnification = np.abs(np.asarray(recording.cameras.focal, np.float64)).mean(-1) / deep
    return LocalFrame(origin, float(np.exp(np.log(magnification).mean()))), magnification


def filled(places: Floats, origin: Floats) -> Floats:
    """Places (T, K, 3), interpolated where they are unknown; a point that is never known is in the middle."""
    filled = np.empty_like(places)
    when = np.arange(len(places))
    for k in range(places.shape[1]):
        known = np.isfinite(places[:, k]).all(-1)
        for axis in range(3):
            at = np.interp(when, when[known], places[known, k, axis]) if known.any() else origin[axis]
            filled[:, k, axis] = at
    return filled
