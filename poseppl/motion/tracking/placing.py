"""Cameras around a walking subject, calibrated cameras from files, and what is in front of them."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, brief
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import Cameras, depth, join_cameras, look_at
from poseppl.motion.geometry.cameras import NEAREST
from poseppl.motion.io import CameraRecord

_WALKS = 300.0
"""A subject that goes less far (mm) is seen in the direction of its first and last place's heading instead."""


def place_cameras(
    path: Floats,
    heading: float,
    *,
    distance: float = 5000.0,
    count: int = 1,
    view: float = 90.0,
    focal: float = 1.0,
) -> Cameras:
    """Place level cameras around a path, at the height of its middle.

    Args:
        path: (T, 3) mm, where the subject's root is; NaN where unknown.
        heading: Angle (radians, about Z, from the Y axis) that the subject faces, for one that stays in place.
        distance: From each camera to the nearest place of the path along its axis, mm.
        count: How many cameras; each next one is turned by a right angle about the subject.
        view: Angle in degrees from the walking direction to the first camera as seen from the subject, clockwise from above: 90
            sees its right side, 0 its front.
        focal: Focal length in image units.

    Returns:
        The cameras; image y points up, as in Eq. 18 of Choo and Fleet 2001.

    Raises:
        InputError: The distance or the angle is out of range, or there is no camera or more than four.
    """
    if not 100.0 <= distance <= 1e6:
        raise InputError(f"{distance:g} mm", field=Argument("camera_distance"), expected="100 to 1000000 mm")
    if not 1 <= count <= 4:
        raise InputError(f"{count} cameras", field=Argument("cameras"), expected="1 to 4")
    if not abs(view) <= 360.0:
        raise InputError(f"{view:g} degrees", field=Argument("view"), expected="-360 to 360")
    seen = path[np.isfinite(path).all(-1)]
    if not len(seen):
        raise InputError("the subject's root is never seen, so that no camera can be placed", field=Argument("camera"))
    middle = (seen.min(0) + seen.max(0)) / 2
    going = seen[-1, :2] - seen[0, :2]
    if np.linalg.norm(going) >= _WALKS:
        heading = float(np.arctan2(-going[0], going[1]))
    cameras = []
    for number in range(count):
        angle = heading - np.radians(view) + number * np.pi / 2
        towards = np.array([-np.sin(angle), np.cos(angle), 0.0])
        reach = float(np.max((seen - middle) @ towards))
        cameras.append(look_at(middle + (distance + reach) * towards, middle, focal))
    return join_cameras(cameras)


def cameras_around(subject: MovingSubject, *, distance: float = 5000.0, count: int = 1, view: float = 90.0) -> Cameras:
    """Place level cameras around a subject; arguments and errors as :func:`place_cameras`."""
    tree = subject.body.tree
    turns = [index for index, (joint, axis) in enumerate(tree.coordinates) if (joint, axis) == (tree.joint_names[0], "Z")]
    heading = float(np.median(subject.states[:, turns[0]])) if turns else 0.0
    path = subject.markers[:, tree.marker_names.index(subject.body.root)]
    return place_cameras(path, heading, distance=distance, count=count, view=view)


def cameras_of_records(records: Sequence[CameraRecord]) -> Cameras:
    """Turn calibrations into cameras.

    Raises:
        InputError: A camera has a skew, which the projection does not know.
    """
    for record in records:
        if abs(record.matrix[0, 1]) > 1e-6 * record.matrix[0, 0]:
            raise InputError(f"camera {brief(record.name)} has a skew of {record.matrix[0, 1]:g}", field="matrix", expected="0")
    return Cameras(
        rotation=jnp.array([record.rotation for record in records], float),
        centre=jnp.array([-record.rotation.T @ record.translation for record in records], float),
        focal=jnp.array([np.diagonal(record.matrix)[:2] for record in records], float),
        principal=jnp.array([record.matrix[:2, 2] for record in records], float),
        distortion=_lenses(records),
    )


def _lenses(records: Sequence[CameraRecord]) -> Array | None:
    """Coefficients (C, 5), (C, 8) or (C, 9) of all lenses, as many as one of them needs; None where none bends anything."""
    fisheye = any(record.fisheye for record in records)
    if not fisheye and not any(np.any(record.distortion != 0) for record in records):
        return None
    width = 9 if fisheye else max(record.distortion.size for record in records)
    table = np.zeros((len(records), width))
    for row, record in zip(table, records, strict=True):
        row[: record.distortion.size] = record.distortion
        row[8:] = record.fisheye
    return jnp.array(table, float)


def records_of_cameras(cameras: Cameras, focal: float, size: tuple[int, int]) -> tuple[CameraRecord, ...]:
    """Turn placed cameras into calibrations in pixels, image y down.

    Args:
        cameras: Cameras of focal length 1.
        focal: Focal length in pixels.
        size: Width and height of the image in pixels.
    """
    matrix = np.array([[focal, 0.0, size[0] / 2], [0.0, focal, size[1] / 2], [0.0, 0.0, 1.0]])
    records = []
    for number, (rotation, centre) in enumerate(zip(cameras.rotation, cameras.centre, strict=True)):
        turn = np.linalg.qr(np.asarray(rotation, np.float64).T)[0].T
        turn *= np.sign(np.sum(turn * np.asarray(rotation), axis=1, keepdims=True))
        place = -turn @ np.asarray(centre, np.float64)
        records.append(CameraRecord(camera_names(len(cameras.centre))[number], matrix, np.zeros(5), turn, place, size))
    return tuple(records)


def camera_names(count: int) -> tuple[str, ...]:
    """Names of placed cameras."""
    return ("camera",) if count == 1 else tuple(f"camera_{number + 1}" for number in range(count))


def check_in_front(
    cameras: Cameras, names: Sequence[str], markers: Floats, marker_names: Sequence[str], frames: Sequence[int]
) -> None:
    """Check that every camera has every marker in front of it.

    Args:
        cameras: C cameras.
        names: Their names.
        markers: (T, K, 3) mm; NaN where unknown.
        marker_names: K names.
        frames: T frame numbers.

    Raises:
        InputError: A marker is at a camera or behind it.
    """
    ahead = np.asarray(depth(cameras, jnp.asarray(markers, float)))
    behind = np.argwhere(ahead < 10 * NEAREST)
    if len(behind):
        camera, frame, marker = behind[0]
        problem = (
            f"camera {brief(names[camera])} has {marker_names[marker]} at or behind it in frame {frames[frame]} "
            f"({ahead[camera, frame, marker]:.0f} mm along its axis)"
        )
        raise InputError(problem, field=Argument("camera"), expected="cameras that face the subject; move or turn the camera")
