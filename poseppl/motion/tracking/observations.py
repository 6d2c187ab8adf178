"""Scenes of image points: observations from a file, or of a moving subject looked at through cameras."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np

from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import body_builder
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.io import CameraRecord, Observations, read_observations
from poseppl.motion.tracking.body_sizes import subject_lengths
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import cameras_of_records, check_in_front
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import MIN_CONFIDENCE, Scene, noise_of


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
        seed: Seed of the noise.

    Raises:
        InputError: The noise or the fraction is out of range, or a marker is not in front of a camera.
    """
    names = subject.body.tree.marker_names
    if not 0 <= missing < 1:
        raise InputError(f"{missing:g}", field=Argument("missing"), expected="a fraction from 0 to below 1")
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
        noise: Standard deviation as a fraction of the focal length; the body's own if None. If the file has confidences, the
            noise is divided by their square roots, and points below 0.05 count as missing.
        rate: Frames a second of the file; None where unknown.
        stature: Stature of the person, mm: the segment lengths of the standard subject in proportion.
        lengths: A TOML file of segment lengths, mm, that are known.

    Raises:
        InputError: The file, the range or a length cannot be used, or the body has clamped joints, which want a truth.
    """
    body = body_builder(model)(subject_lengths(model, stature, lengths))
    if body.free is not None:
        problem = f"the body tracks {', '.join(body.free)} alone and needs the truth for the rest, which observations lack"
        raise InputError(problem, field=Argument("model"), expected="a recording, or a body without clamped joints")
    names = [record.name for record in records]
    observed = read_observations(path, body.tree.marker_names, names)
    cameras = cameras_of_records(records)
    spread = noise_of(body, cameras, noise)
    part = FrameRange.parse(frames).within(len(observed.points), str(path))
    points, confidence = observed.points[part], None if observed.confidence is None else observed.confidence[part]
    if confidence is not None:
        points = np.where((confidence >= MIN_CONFIDENCE)[..., None], points, np.nan)
        spread = spread / np.sqrt(np.clip(np.nan_to_num(confidence, nan=1.0), MIN_CONFIDENCE, 1.0))
    if not np.isfinite(points).any():
        raise InputError("no point is seen in the chosen frames", file=path, field=Argument("frames"))
    data = PointData(points, spread)
    return Scene(body, cameras, tuple(names), data, observed.frames[part], rate and rate / part.step, str(path))


def observations_of_scene(scene: Scene[PointData]) -> Observations:
    """The points of a scene, ready to be written."""
    return Observations(scene.data.points, None, scene.frames, scene.body.tree.marker_names, scene.camera_names)
