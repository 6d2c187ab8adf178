"""A scene: a body, cameras, and what they saw of it over time, with the truth where it is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.errors import FilePath, InputError
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import DEFAULT_MODEL, Body, body_builder
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.io import CameraRecord, Observations, read_observations
from poseppl.motion.recordings.placing import cameras_of_records, check_in_front
from poseppl.motion.tracking.body_sizes import subject_lengths
from poseppl.motion.tracking.point_data import PointData
from poseppl.program import CompiledModel, Observation

LEAST_CONFIDENCE = 0.05
"""Points of less confidence count as not seen."""


class SceneData(Protocol):
    """Observations of a body by cameras: points or silhouettes. All that differs between the two is asked here."""

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Attributes of a result that tell of the data, by name."""

    @property
    def faults(self) -> Mapping[str, Floats]:
        """Probabilities (T, ...) that data are wrong, by name."""

    def first_frames(self, count: int) -> Self:
        """The data of the first frames alone."""

    def seek(self, scene: Any, params: Mapping[str, float]) -> Floats:
        """The state (d,) to start from, sought in the scene's data.

        Args:
            scene: The scene that the data are of.
            params: Of the body's programs.

        Raises:
            InputError: No frame shows enough to start from.
        """

    def inputs(self, body: Body, walk: Mapping[str, Any]) -> Any:
        """The inputs of the body's programs, as :func:`poseppl.runs.run.run_filter` takes them.

        Args:
            body: The body.
            walk: The inputs that do not depend on the data, by name: cameras, start, step scales and tree.
        """

    def observe(self, model: CompiledModel) -> Observation:
        """The data of the body's compiled model."""

    def observed(self, body: Body) -> dict[str, NDArray[Any]]:
        """Arrays of the data that a result keeps, (T, ...) by name; ``points`` (T, C, K, 2) among them."""

    def quality(self, scene: Any, states: Any) -> dict[str, NDArray[Any]]:
        """Figures (T, ...) by name of how well states (T, d) agree with the scene's data."""


Data = TypeVar("Data", bound=SceneData, covariant=True)


class Scene(NamedTuple, Generic[Data]):
    """A body to be tracked, with its cameras and data.

    Attributes:
        body: The body.
        cameras: C cameras.
        camera_names: Their names.
        data: What they saw.
        frames: (T,) frame numbers.
        rate: Frames a second, of frames whose numbers are as far apart as most; None where unknown.
        source: Where it came from.
        states: (T, d) the true states; None where unknown.
        markers: (T, K, 3) mm, true places; None where unknown.
        residual: Mean distance (mm) of the markers from those of the states, where these come from inverse kinematics.
    """

    body: Body
    cameras: Cameras
    camera_names: tuple[str, ...]
    data: Data
    frames: Integers
    rate: float | None
    source: str
    states: Floats | None = None
    markers: Floats | None = None
    residual: float | None = None

    def first_frames(self, count: int) -> Scene[Data]:
        """The first frames alone: what a run that stopped has seen."""
        states, markers = (None if truth is None else truth[:count] for truth in (self.states, self.markers))
        return self._replace(data=self.data.first_frames(count), frames=self.frames[:count], states=states, markers=markers)


def noise_of(body: Body, cameras: Cameras, noise: float | None) -> Floats:
    """Standard deviations (C, K) of image points.

    Args:
        body: The body.
        cameras: C cameras.
        noise: As a fraction of the focal length; the body's own if None.

    Raises:
        InputError: The noise is not positive.
    """
    level = body.noise if noise is None else noise
    if not 0 < level < 10:
        raise InputError(f"{level:g}", field="--noise", expected="a positive fraction of the focal length, such as 0.003")
    scale = np.abs(np.asarray(cameras.focal, np.float64)).mean(-1)
    return np.repeat(level * scale[:, None], len(body.tree.marker_names), axis=1)


def observe_motion(
    subject: MovingSubject,
    cameras: Cameras,
    camera_names: Sequence[str],
    *,
    noise: float | None = None,
    missing: float = 0.0,
    seed: int = 0,
) -> Scene[PointData]:
    """Look at a moving subject through cameras, with noise.

    Args:
        subject: The subject.
        cameras: C cameras.
        camera_names: Their names.
        noise: Standard deviation as a fraction of the focal length; the body's own if None.
        missing: Fraction of the points that are not seen, at random.
        seed: Of the noise.

    Raises:
        InputError: The noise or the fraction is out of range, or a marker is not in front of a camera.
    """
    names = subject.body.tree.marker_names
    if not 0 <= missing < 1:
        raise InputError(f"{missing:g}", field="--missing", expected="a fraction from 0 to below 1")
    check_in_front(cameras, camera_names, subject.markers, names, subject.frames.tolist())
    spread = noise_of(subject.body, cameras, noise)
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(subject.markers, float)), np.float64), 0, 1)
    rng = np.random.default_rng(seed)
    points = clean + spread[..., None] * rng.standard_normal(clean.shape)
    unknown = np.asarray(np.isnan(subject.markers).any(axis=-1))
    hidden = unknown[:, None] | (rng.random(points.shape[:-1]) < missing)
    points[hidden] = np.nan
    when = (subject.frames, subject.rate, subject.source)
    truth = (subject.states, subject.markers, subject.residual)
    return Scene(subject.body, cameras, tuple(camera_names), PointData(points, spread), *when, *truth)


def scene_of_observations(
    path: FilePath,
    records: Sequence[CameraRecord],
    *,
    model: str = DEFAULT_MODEL,
    frames: str | None = None,
    noise: float | None = None,
    rate: float | None = None,
    stature: float | None = None,
    lengths: FilePath | None = None,
) -> Scene[PointData]:
    """Read 2-D observations that come without truth.

    Args:
        path: The CSV file.
        records: The calibrated cameras.
        model: Builder of the body.
        frames: Range "start:stop:step" of the file's frames, counted from 0; all if None.
        noise: Standard deviation as a fraction of the focal length; the body's own if None. Where the file tells a
            confidence, it is divided by the root of that, and points below 0.05 count as not seen.
        rate: Frames a second of the file; None where unknown.
        stature: Of the person, mm: the segment lengths of the standard subject in proportion.
        lengths: A TOML file of segment lengths, mm, that are known.

    Raises:
        InputError: The file, the range or a length cannot be used, or the body has clamped joints, which want a truth.
    """
    body = body_builder(model)(subject_lengths(model, stature, lengths))
    if body.free is not None:
        problem = f"the body tracks {', '.join(body.free)} alone and needs the truth for the rest, which observations lack"
        raise InputError(problem, field="--model", expected="a recording, or a body without clamped joints")
    names = [record.name for record in records]
    observed = read_observations(path, body.tree.marker_names, names)
    cameras = cameras_of_records(records)
    spread = noise_of(body, cameras, noise)
    part = FrameRange.parse(frames).within(len(observed.points), str(path))
    points, confidence = observed.points[part], None if observed.confidence is None else observed.confidence[part]
    if confidence is not None:
        points = np.where((confidence >= LEAST_CONFIDENCE)[..., None], points, np.nan)
        spread = spread / np.sqrt(np.clip(np.nan_to_num(confidence, nan=1.0), LEAST_CONFIDENCE, 1.0))
    if not np.isfinite(points).any():
        raise InputError("no point is seen in the chosen frames", file=path, field="--frames")
    data = PointData(points, spread)
    return Scene(body, cameras, tuple(names), data, observed.frames[part], rate and rate / part.step, str(path))


def observations_of_scene(scene: Scene[PointData]) -> Observations:
    """The points of a scene, ready to be written."""
    return Observations(scene.data.points, None, scene.frames, scene.body.tree.marker_names, scene.camera_names)
