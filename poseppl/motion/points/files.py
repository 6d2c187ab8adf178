"""From files of named points in calibrated cameras to a recording, and from its smoothing to a result."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr
from poseppl_models.bodies.named_points import points_in_cameras

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, InputError
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import name_of_builder
from poseppl.motion.geometry import project
from poseppl.motion.io import DetectedPeople
from poseppl.motion.io.cameras import calibration_of
from poseppl.motion.io.detections import check_different, without_strays
from poseppl.motion.io.keypoints import read_keypoints
from poseppl.motion.io.skeleton_files import Skeleton, read_skeleton
from poseppl.motion.io.text_parsing import some
from poseppl.motion.io.units_and_axes import UNKNOWN_UNIT
from poseppl.motion.points.named_points import FREEDOM, PointRecording
from poseppl.motion.points.settings import PointSettings
from poseppl.motion.points.smoothing import PointTracks
from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.track import versions
from poseppl.motion.tracking.walk import ASSUMED_RATE, UNKNOWN_RATE

FEW = 0.4
"""Share of frames without any point above which a camera is reported."""


def read_point_recording(settings: PointSettings) -> PointRecording:
    """Read what a detector found of one animal or thing.

    Raises:
        InputError: A file cannot be read, has no camera or other points than the others, or there is no common frame.
    """
    files, skeleton, rate = settings.files, skeleton_of(settings), settings.rate
    calibration = calibration_of(settings)
    known = {record.name: record for record in calibration.cameras}
    for name in files:
        if name not in known:
            raise InputError(f"no camera {name!r} in the calibration", field=Argument("files"), expected=", ".join(known))
    notes: list[str] = [*([] if calibration.unit else [UNKNOWN_UNIT]), *([] if rate else [UNKNOWN_RATE])]
    found = {}
    for camera, path in files.items():
        read = read_keypoints(path, settings.detector, size=known[camera].size, camera=camera, cameras=tuple(known))
        found[camera], strays = without_strays(read, known[camera].size, camera)
        notes += [f"{camera}: {note}" for note in read.notes] + strays
    check_different(found)
    names = next(iter(found.values())).names if skeleton is None else skeleton.points
    for camera, people in found.items():
        missing = [name for name in names if name not in people.names]
        if missing:
            raise InputError(
                f"no point {missing[0]!r}", file=files[camera], field=Argument("skeleton"), expected=some(people.names)
            )
    rows = [_individual(found, camera, settings.person, files[camera]) for camera in files]
    held = {camera: set(people.frames.tolist()) for camera, people in found.items()}
    if len(files) > 1 and not any(held[one] & held[other] for one, other in itertools.combinations(held, 2)):
        raise InputError("the files have no frame in common", field=Argument("files"), expected="equal frame numbers")
    numbers = sorted(set.union(*held.values()))
    part = FrameRange.parse(settings.frames).within(len(numbers), "the files' common frames")
    chosen = np.asarray(numbers)[part]
    tables = [_of_names(people, names, chosen, row) for people, row in zip(found.values(), rows, strict=True)]
    for camera, (points, _) in zip(files, tables, strict=True):
        notes += _notes_on_gaps(camera, points, chosen, held[camera])
    cameras = [known[name] for name in files]
    return PointRecording(
        tuple(names),
        tuple(files),
        cameras_of_records(cameras),
        np.array([camera.size for camera in cameras], float),
        np.stack([points for points, _ in tables], 1),
        np.stack([confidence for _, confidence in tables], 1),
        chosen,
        (chosen - chosen[0]) / (rate or ASSUMED_RATE),
        rate and rate / part.step,
        ", ".join(map(str, dict.fromkeys(map(str, files.values())))),
        tuple(notes),
    )


def skeleton_of(settings: PointSettings) -> Skeleton | None:
    """The skeleton that settings name, or are given; None where there is none.

    Raises:
        InputError: The file cannot be used.
    """
    given = settings.skeleton
    return read_skeleton(given) if isinstance(given, str | PathLike) else given


def _individual(found: Mapping[str, DetectedPeople], camera: str, person: int, path: FilePath) -> int:
    """Index in a camera's file of the individual with that number in the file that names most."""
    names, most = found[camera].individuals, max((people.individuals for people in found.values()), key=len)
    count = max(people.points.shape[1] for people in found.values())
    if person > count:
        raise InputError(f"{person}", file=path, field=Argument("person"), expected=f"1 to {count}")
    if count == 1:
        return 0
    if len(most) < count:
        problem = f"{count} in a frame, without names to identify them in the next one"
        raise InputError(
            problem, file=path, field=Argument("files"), expected="one animal, or several that are tracked by name"
        )
    if most[person - 1] not in names:
        raise InputError(f"no {most[person - 1]!r}", file=path, field=Argument("person"), expected=some(names))
    return names.index(most[person - 1])


def _of_names(people: DetectedPeople, names: Sequence[str], numbers: Any, person: int) -> tuple[Floats, Floats]:
    """Points (T, K, 2) and confidence (T, K) of the names, at frames of these numbers; NaN and 0 where the file has none."""
    held, rows, _ = np.intersect1d(people.frames, numbers, return_indices=True)
    columns = [people.names.index(name) for name in names]
    at = np.searchsorted(numbers, held)
    points, confidence = np.full((len(numbers), len(names), 2), np.nan), np.zeros((len(numbers), len(names)))
    points[at], confidence[at] = people.points[rows][:, person, columns], people.confidence[rows][:, person, columns]
    return points, confidence


def _notes_on_gaps(camera: str, points: Floats, numbers: Integers, held: set[int]) -> list[str]:
    """Frames that a camera's file lacks, or in most of which nothing was found."""
    missing = [number for number in numbers.tolist() if number not in held]
    notes = []
    if missing:
        notes.append(f"{camera}: its file lacks {len(missing)} of {len(numbers)} frames, from {missing[0]} to {missing[-1]}")
    empty = 1 - np.isfinite(points).all(-1).any(-1).mean()
    if empty > FEW:
        notes.append(f"{camera}: nothing was found in {empty:.0%} of {len(numbers)} frames")
    return notes


def result_of_points(
    recording: PointRecording, tracks: PointTracks, edges: Sequence[tuple[int, int]], seed: int
) -> xr.DataTree:
    """The result of a smoothing; see :mod:`poseppl.runs.results`. Its state are the points' coordinates, mm.

    Args:
        recording: The smoothed recording.
        tracks: Its smoothing.
        edges: Pairs of points that are drawn as lines.
        seed: Seed of the draws.
    """
    places = tracks.places.astype(np.float32)
    images = [np.moveaxis(np.asarray(project(recording.cameras, jnp.asarray(place))), 0, 1) for place in places]
    cameras = {name: None if leaf is None else np.asarray(leaf) for name, leaf in recording.cameras._asdict().items()}
    flat = places.reshape(1, *places.shape[:2], -1)
    return body_result(
        state=flat,
        names=BodyNames(
            [f"{name}.{axis}" for name in recording.names for axis in "xyz"], recording.names, recording.camera_names
        ),
        extras={"markers": places[None], "points": np.stack(images)[None]},
        sample_stats={},
        observed={"points": recording.points, "confidence": recording.confidence},
        faults={"clutter": tracks.clutter, "swaps": tracks.swaps},
        cameras=cameras,
        edges=edges,
        frames=recording.frames,
        rate=recording.rate,
        attrs={
            "model": name_of_builder(points_in_cameras),
            "smoother": "laplace",
            "smoother seed": seed,
            "errors": "lasting",
            "params": {name: np.asarray(value).tolist() for name, value in tracks.params.items()},
            "pixels a mm": tracks.frame.unit,
            "freedom": FREEDOM,
            "input": recording.source,
            "versions": versions(),
        },
    )
