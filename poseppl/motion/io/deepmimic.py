"""DeepMimic clips: a character file with the skeleton, and a motion file with one row of numbers a frame.

A row holds the frame's duration (s), the root's place (m), and for each joint in the character's order its rotation: a
quaternion w, x, y, z for the root and for spherical joints, an angle (radians, about the joint's z axis) for revolute ones.
Y is up. See `humanoid3d.txt` of the DeepMimic project (Peng, Abbeel, Levine and van de Panne 2018,
doi:10.1145/3197517.3201311).
"""

from __future__ import annotations

import json
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from poseppl.errors import InputError
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.motion import Motion, to_z_up

_WIDTHS = {"none": 4, "spherical": 4, "revolute": 1, "fixed": 0}
_MAX_JOINTS = 500
_MM = 1000.0


class _Joint(NamedTuple):
    """A joint: its offset (3,) in the parent's frame, in metres, and how many numbers of a row turn it."""

    name: str
    parent: int
    offset: NDArray[np.float64]
    width: int


def read_deepmimic(path: str | PathLike[str], character: str | PathLike[str]) -> Motion:
    """Read a clip.

    Args:
        path: The motion file.
        character: The character file.

    Returns:
        The motion of the joints, Z up, in mm; ``angles`` is None.

    Raises:
        InputError: A file is malformed, or they do not belong together.
    """
    joints = _read_joints(character)
    rows = _read_rows(path, 4 + sum(joint.width for joint in joints))
    places = np.zeros((len(rows), len(joints), 3))
    turns: list[Rotation] = []
    column = 4
    for index, joint in enumerate(joints):
        values = rows[:, column : column + joint.width]
        column += joint.width
        turn = _rotation(path, joint, values)
        if joint.parent < 0:
            places[:, index] = rows[:, 1:4]
            turns.append(turn)
        else:
            before = turns[joint.parent]
            places[:, index] = places[:, joint.parent] + before.apply(joint.offset)
            turns.append(before * turn)
    names, parents = tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints)
    rate = 1.0 / float(np.median(rows[:-1, 0] if len(rows) > 1 else rows[:, 0]))
    return to_z_up(Motion(names, places * _MM, parents, None, round(rate, 2), "y", str(path)))


def _rotation(path: str | PathLike[str], joint: _Joint, values: NDArray[np.float64]) -> Rotation:
    if joint.width == 0:
        return Rotation.identity(len(values))
    if joint.width == 1:
        return Rotation.from_rotvec(np.concatenate([np.zeros((len(values), 2)), values], axis=1))
    size = np.linalg.norm(values, axis=1)
    wrong = np.flatnonzero(np.abs(size - 1) > 0.05)
    if len(wrong):
        problem = f"the quaternion of {joint.name} has length {size[wrong[0]]:.3g} in frame {wrong[0]}"
        raise InputError(problem, file=path, expected="1; does the character belong to this motion?")
    return Rotation.from_quat(values[:, [1, 2, 3, 0]])


def _read_joints(path: str | PathLike[str]) -> list[_Joint]:
    known = _read_json(path)
    listed = known.get("Skeleton", {}).get("Joints") if isinstance(known.get("Skeleton"), dict) else None
    if not isinstance(listed, list) or not 0 < len(listed) <= _MAX_JOINTS:
        raise InputError("no skeleton", file=path, field="Skeleton.Joints", expected="a DeepMimic character file")
    return [_joint(path, index, row) for index, row in enumerate(listed)]


def _joint(path: str | PathLike[str], index: int, row: Any) -> _Joint:
    field = f"Skeleton.Joints[{index}]"
    try:
        name, kind, parent = str(row["Name"]), str(row["Type"]), int(row["Parent"])
        offset = np.array([row[f"Attach{axis}"] for axis in "XYZ"], dtype=np.float64)
        turned = any(float(row.get(f"AttachTheta{axis}", 0.0)) for axis in "XYZ")
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise InputError(f"not a joint: {error!r}", file=path, field=field) from error
    if kind not in _WIDTHS or turned or not np.isfinite(offset).all():
        raise InputError(f"joint {name!r} is not supported", file=path, field=field, expected=f"one of {', '.join(_WIDTHS)}")
    if not (-1 <= parent < index) or (parent == -1) != (index == 0):
        raise InputError(f"the parent of {name!r} is {parent}", file=path, field=field, expected="an earlier joint")
    return _Joint(name, parent, offset, _WIDTHS[kind])


def _read_rows(path: str | PathLike[str], width: int) -> NDArray[np.float64]:
    listed = _read_json(path).get("Frames")
    if not isinstance(listed, list) or not listed:
        raise InputError("no frames", file=path, field="Frames", expected="a DeepMimic motion file")
    for index, row in enumerate(listed):
        if not isinstance(row, list) or len(row) != width or not all(type(value) in (int, float) for value in row):
            raise InputError(f"frame {index} is no row of {width} numbers", file=path, field="Frames")
    rows = np.array(listed, dtype=np.float64)
    if not np.isfinite(rows).all() or np.abs(rows).max() > 1e6:
        raise InputError("a number that is not finite, or absurdly large", file=path, field="Frames")
    if not (rows[: max(1, len(rows) - 1), 0] > 0).all():
        raise InputError("a frame without duration", file=path, field="Frames")
    return rows


def _read_json(path: str | PathLike[str]) -> dict[str, Any]:
    try:
        known = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}", file=path, expected="a file of the DeepMimic project") from error
    if not isinstance(known, dict):
        raise InputError("not a JSON object", file=path, expected="a file of the DeepMimic project")
    return known
