"""Motions whose skeleton is a JSON file, with a row of numbers a frame: DeepMimic's clips, and exponential maps.

A row of DeepMimic holds the frame's duration (s), the root's place (m), and for each joint in the character's order its
rotation: a quaternion w, x, y, z for the root and for spherical joints, an angle (radians, about the joint's z axis) for
revolute ones. Y is up. See `humanoid3d.txt` of the DeepMimic project (Peng, Abbeel, Levine and van de Panne 2018,
doi:10.1145/3197517.3201311).

Exponential maps have other rows. Columns 0 to 2 are the root's translation, columns 3 + 3j to 5 + 3j the exponential map v
(axis times angle, radians) of joint j, of matrices that act on rows: as a rotation of columns it is exp(-[v]), from the
joint's axes to its parent's. The skeleton lists ``parent`` (-1 for the root) and ``offset`` of every joint from its parent, in
the parent's axes. Lengths are in units of CMU's ASF skeletons, 1/0.45 inch. Y is up. In this form the walks of CMU's database
serve the literature on human motion prediction (Fragkiadaki, Levine, Felsen and Malik 2015, doi:10.1109/ICCV.2015.494). Joints
have no names there; those of the 38 joints of CMU are given here.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief, cut
from poseppl.files.bounded_reading import read_json
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.motion import Motion, joint_positions, z_up
from poseppl.motion.io.text_parsing import LARGEST, number_rows

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
    rows = _clip_rows(path, 4 + sum(joint.width for joint in joints))
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


def _clip_rows(path: FilePath, width: int) -> Floats:
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


UNIT_MM = 25.4 / 0.45
MAX_JOINTS = 500
MAX_POINTS = 5_000_000
RATE = 120.0
_LEG = ("HipJoint", "UpLeg", "Leg", "Foot", "ToeBase", "Toe_end")
_ARM = ("Shoulder", "Arm", "ForeArm", "Hand", "FingerBase", "HandIndex1", "HandIndex1_end", "Thumb", "Thumb_end")
CMU_JOINTS = (
    "Hips",
    *(f"Left{part}" for part in _LEG),
    *(f"Right{part}" for part in _LEG),
    *("LowerBack", "Spine", "Spine1", "Neck", "Neck1", "Head", "Head_end"),
    *(f"Left{part}" for part in _ARM),
    *(f"Right{part}" for part in _ARM),
)
"""Names of the joints of CMU's skeleton where it has 38 of them."""


def read_exponential_maps(path: FilePath, skeleton: FilePath, *, rate: float = RATE) -> Motion:
    """Read a motion.

    Args:
        path: The file of numbers.
        skeleton: The JSON file with ``parent`` and ``offset``.
        rate: Frames a second, which the file does not tell.

    Returns:
        The motion of the joints, Z up, in mm.

    Raises:
        InputError: A file is malformed, or they do not belong together.
    """
    parents, offsets = _read_skeleton(skeleton)
    rows = _map_rows(path, len(parents))
    turns = [Rotation.from_rotvec(-rows[:, column : column + 3]) for column in range(3, rows.shape[1], 3)]
    places = joint_positions(parents, offsets, turns, rows[:, :3] + offsets[0])
    names = CMU_JOINTS if len(parents) == len(CMU_JOINTS) else tuple(f"joint_{joint}" for joint in range(len(parents)))
    return Motion(names, z_up(places * UNIT_MM, "y"), parents, rate, str(path))


def _read_skeleton(path: FilePath) -> tuple[tuple[int, ...], Floats]:
    at, expected = Location(path), "a JSON object with parent, a list of whole numbers, and offset, a list of as many triples"
    known: Any = read_json(path)
    try:
        parents, offsets = known["parent"], np.array(known["offset"], np.float64)
        whole = isinstance(parents, list) and all(type(parent) is int for parent in parents)
        if not whole or not 0 < len(parents) <= MAX_JOINTS or offsets.shape != (len(parents), 3):
            raise ValueError("lists of another form")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise at.error(f"no skeleton: {cut(error, 80)}", expected) from error
    for joint, parent in enumerate(parents):
        if not -1 <= parent < joint or (parent == -1) != (joint == 0):
            raise at.in_field("parent").error(f"the parent of joint {joint} is {brief(parent)}", "an earlier joint")
    if not (np.abs(offsets) <= LARGEST).all():
        raise at.in_field("offset").error("a number that is not finite, or too large", "at most 1e9")
    return tuple(parents), offsets


def _map_rows(path: FilePath, num_joints: int) -> Floats:
    of = ("translation", *(f"joint {joint}" for joint in range(num_joints)))
    rows = number_rows(rows_of_csv(path), [f"{name} {axis}" for name in of for axis in "xyz"], 3 * MAX_POINTS)
    if not len(rows):
        raise Location(path).error("no frame", "rows of numbers")
    return rows
