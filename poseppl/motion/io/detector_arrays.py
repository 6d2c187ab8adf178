"""Points that detectors store as arrays: SLEAP in HDF5, FreeMoCap as one NumPy array of all cameras."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, cut
from poseppl.files.hdf5_reading import array, attribute, open_hdf5, texts
from poseppl.files.numpy_arrays import read_array
from poseppl.motion.io.detections import (
    MAX_FRAMES,
    MAX_PEOPLE,
    MAX_POINTS,
    MAX_VALUES,
    DetectedPeople,
    check_names,
    people_of_table,
)
from poseppl.motion.io.keypoint_layouts import LAYOUTS

_SLEAP = "an analysis file of SLEAP (Export Analysis HDF5)"
_TRACKS, _SCORES = ("track", "xy", "node", "frame"), ("track", "node", "frame")


def read_sleap(path: FilePath) -> DetectedPeople:
    """Read an analysis file of SLEAP.

    ``tracks`` (tracks, 2, nodes, frames) has the positions of all animals' nodes in all frames, NaN where there is none, and
    ``point_scores`` (tracks, nodes, frames) their scores. Newer exports have other orders, which their attribute ``dims``
    gives. Points without a score, such as those that were corrected by hand, have a confidence of 1.

    Args:
        path: The file.

    Returns:
        The points under the names of the nodes; ``individuals`` are the tracks where they have names.

    Raises:
        InputError: The file is none, is damaged, or holds no point.
    """
    at = Location(path)
    with open_hdf5(path, _SLEAP) as file:
        nodes = texts(array(file, "node_names", at))
        tracks = texts(array(file, "track_names", at)) if "track_names" in file else []
        points = _ordered(file, "tracks", _TRACKS, at)
        scores = _ordered(file, "point_scores", _SCORES, at) if "point_scores" in file else None
    check_names(nodes, "nodes", at)
    people, _, count, frames = points.shape
    if count != len(nodes) or (tracks and len(tracks) != people):
        raise at.in_field("tracks").error(f"shape {points.shape}", f"{len(tracks) or 1} tracks and {len(nodes)} nodes")
    if people > MAX_PEOPLE or count > MAX_POINTS or frames > MAX_FRAMES or 3 * people * count * frames > MAX_VALUES:
        expected = f"at most {MAX_PEOPLE}, {MAX_POINTS} and {MAX_FRAMES}, and {MAX_VALUES} numbers"
        raise at.in_field("tracks").error(f"{people} tracks of {count} nodes in {frames} frames", expected)
    if scores is not None and scores.shape != (people, count, frames):
        raise at.in_field("point_scores").error(f"shape {scores.shape}", f"{(people, count, frames)}, as tracks has")
    table = np.ones((frames, people, count, 3))
    table[..., :2] = points.transpose(3, 0, 2, 1)
    if scores is not None:
        graded = scores.transpose(2, 0, 1)
        table[..., 2] = np.where(np.isnan(graded), 1.0, graded)
    found = people_of_table(table, np.arange(frames), nodes, at)
    return found._replace(individuals=tuple(tracks) if len(set(tracks)) == people else ())


def _ordered(file: Any, name: str, axes: tuple[str, ...], at: Location) -> Floats:
    """An array with its axes in our order."""
    values = array(file, name, at)
    where = at.in_field(name)
    if values.dtype.kind != "f" or values.ndim != len(axes):
        raise where.error(f"values of type {values.dtype} and shape {values.shape}", f"numbers by {', '.join(axes)}")
    stored = _dimensions(file, name, at)
    order = axes if stored is None else [axis for axis in stored if axis in axes]
    if sorted(order) != sorted(axes):
        raise where.in_field("dims").error(f"axes {cut(', '.join(map(str, order)), 80)}", ", ".join(axes))
    values = values.transpose([order.index(axis) for axis in axes])
    if "xy" in axes and values.shape[1] != 2:
        raise where.error(f"shape {values.shape}", f"numbers by {', '.join(axes)}, two of xy")
    return np.asarray(values, np.float64)


def _dimensions(file: Any, name: str, at: Location) -> tuple[str, ...] | None:
    """Names of axes, where the file has them."""
    stored = attribute(file[name], "dims", at)
    if stored is None:
        return None if attribute(file, "transpose", at) in (None, True, 1) else ("frame", "node", "xy", "track")
    try:
        names = json.loads(stored)
    except (ValueError, TypeError, RecursionError) as error:
        raise at.in_field("dims").error("no names of axes", ", ".join(_TRACKS)) from error
    return tuple(map(str, names)) if isinstance(names, list) else ()


_BODY = LAYOUTS["mediapipe33"]
_FREEMOCAP = f"numbers by camera, frame, point and x, y, with {len(_BODY)} points of the body first"


def read_freemocap(path: FilePath, camera: str | None, cameras: Sequence[str] = ()) -> DetectedPeople:
    """Read one camera of FreeMoCap's array.

    The array is (cameras, frames, points, 2 or 3) in px. Points are MediaPipe's 33 of the body; those of hands and face that
    follow are left out. A point that was not found is NaN, or at 0, 0. There is no confidence: a point that was found has 1.

    Args:
        path: The .npy file.
        camera: The camera.
        cameras: All cameras of the calibration, in the order of the array.

    Raises:
        InputError: The file is no such array, or has another number of cameras.
    """
    at = Location(path)
    values = read_array(path, max_values=MAX_VALUES)
    if values.ndim != 4 or values.shape[3] not in (2, 3) or not len(_BODY) <= values.shape[2] <= MAX_POINTS:
        raise at.error(f"an array of shape {values.shape}", _FREEMOCAP)
    if camera is None or camera not in cameras or len(values) != len(cameras):
        problem = f"the array has {len(values)} cameras, the calibration {len(cameras)}: {', '.join(cameras)}"
        raise at.error(problem, "a calibration of the cameras of the array, in their order")
    if not 0 < values.shape[1] <= MAX_FRAMES:
        raise at.error(f"{values.shape[1]} frames", f"1 to {MAX_FRAMES}")
    own: Floats = np.asarray(values, np.float64)[list(cameras).index(camera)]
    points = own[:, : len(_BODY), :2]
    table = np.concatenate([points, np.ones((*points.shape[:2], 1))], axis=2)[:, None]
    return people_of_table(table, np.arange(len(table)), _BODY, at)._replace(layout="mediapipe33")
