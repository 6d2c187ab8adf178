"""DeepMimic clips: a character file with the skeleton, and a motion file with one row of numbers a frame.

A row holds the frame's duration (s), the root's place (m), and for each joint in the character's order its rotation: a
quaternion w, x, y, z for the root and for spherical joints, an angle (radians, about the joint's z axis) for revolute ones.
Y is up. See `humanoid3d.txt` of the DeepMimic project (Peng, Abbeel, Levine and van de Panne 2018,
doi:10.1145/3197517.3201311).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_json
from poseppl.motion.io.motion import Motion, joint_positions, z_up

_WIDTHS = {"none": 4, "spherical": 4, "revolute": 1, "fixed": 0}
_MAX_JOINTS = 500
_LARGEST = 1e6
_MM = 1000.0


class _Joint(NamedTuple):
    """A joint: its offset (3,) in the parent's frame, in metres, and how many numbers of a row turn it."""

    name: str
    parent: int
    offset: Floats
    width: int


def read_deepmimic(path: FilePath, character: FilePath) -> Motion:
    """Read a clip.

    Args:
        path: The motion file.
        character: The character file.

    Returns:
        The motion of the joints, Z up, in mm.

    Raises:
        InputError: A file is malformed, or they do not belong together.
    """
    joints = _read_joints(character)
    rows = _read_rows(path, 4 + sum(joint.width for joint in joints))
    ends = np.cumsum([4, *(joint.width for joint in joints)])
    turns = [
        _rotation(Location(path), joint, rows[:, start:end])
        for joint, start, end in zip(joints, ends[:-1], ends[1:], strict=True)
    ]
    names, parents = tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints)
    places = joint_positions(parents, [joint.offset for joint in joints], turns, rows[:, 1:4])
    rate = 1.0 / float(np.median(rows[:-1, 0] if len(rows) > 1 else rows[:, 0]))
    return Motion(names, z_up(places * _MM, "y"), parents, round(rate, 2), str(path))


def _rotation(at: Location, joint: _Joint, values: Floats) -> Rotation:
    if joint.width == 0:
        return Rotation.identity(len(values))
    if joint.width == 1:
        return Rotation.from_rotvec(np.concatenate([np.zeros((len(values), 2)), values], axis=1))
    size = np.linalg.norm(values, axis=1)
    wrong = np.flatnonzero(np.abs(size - 1) > 0.05)
    if len(wrong):
        problem = f"the quaternion of {joint.name} has length {size[wrong[0]]:.3g} in frame {wrong[0]}"
        raise at.error(problem, "1; does the character belong to this motion?")
    return Rotation.from_quat(values[:, [1, 2, 3, 0]])


def _read_joints(path: FilePath) -> list[_Joint]:
    known, at = _read_object(path), Location(path, field="Skeleton.Joints")
    listed = known.get("Skeleton", {}).get("Joints") if isinstance(known.get("Skeleton"), dict) else None
    if not isinstance(listed, list) or not 0 < len(listed) <= _MAX_JOINTS:
        raise at.error("no skeleton", "a DeepMimic character file")
    return [_joint(at.in_field(f"{at.field}[{index}]"), index, row) for index, row in enumerate(listed)]


def _joint(at: Location, index: int, row: Any) -> _Joint:
    try:
        name, kind, parent = str(row["Name"]), str(row["Type"]), int(row["Parent"])
        offset = np.array([row[f"Attach{axis}"] for axis in "XYZ"], dtype=np.float64)
        turned = any(float(row.get(f"AttachTheta{axis}", 0.0)) for axis in "XYZ")
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise at.error(f"not a joint: {brief(error)}") from error
    if kind not in _WIDTHS or turned or not np.isfinite(offset).all():
        raise at.error(f"joint {brief(name)} is not supported", f"one of {', '.join(_WIDTHS)}")
    if not (-1 <= parent < index) or (parent == -1) != (index == 0):
        raise at.error(f"the parent of {brief(name)} is {brief(parent)}", "an earlier joint")
    return _Joint(name, parent, offset, _WIDTHS[kind])


def _read_rows(path: FilePath, width: int) -> Floats:
    listed, at = _read_object(path).get("Frames"), Location(path, field="Frames")
    if not isinstance(listed, list) or not listed:
        raise at.error("no frames", "a DeepMimic motion file")
    for index, row in enumerate(listed):
        if not isinstance(row, list) or len(row) != width or not all(type(value) in (int, float) for value in row):
            raise at.error(f"frame {index} is no row of {width} numbers")
    if not all(abs(value) <= _LARGEST for row in listed for value in row):
        raise at.error("a number that is not finite, or absurdly large", f"at most {_LARGEST:g}")
    rows = np.array(listed, dtype=np.float64)
    if not (rows[: max(1, len(rows) - 1), 0] > 0).all():
        raise at.error("a frame without duration")
    return rows


def _read_object(path: FilePath) -> dict[str, Any]:
    known = read_json(path)
    if not isinstance(known, dict):
        raise Location(path).error("not a JSON object", "a file of the DeepMimic project")
    return known
