"""Motions as exponential maps: a row of comma-separated numbers a frame, and the skeleton as JSON beside them.

Columns 0 to 2 are the root's translation, columns 3 + 3j to 5 + 3j the exponential map v (axis times angle, radians) of
joint j, of matrices that act on rows: as a rotation of columns it is exp(-[v]), from the joint's axes to its parent's. The
skeleton lists ``parent`` (-1 for the root) and ``offset`` of every joint from its parent, in the parent's axes. Lengths are
in units of CMU's ASF skeletons, 1/0.45 inch. Y is up. In this form the walks of CMU's database serve the literature on
human motion prediction (Fragkiadaki, Levine, Felsen and Malik 2015, doi:10.1109/ICCV.2015.494). Joints have no names there;
those of the 38 joints of CMU are given here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief, cut
from poseppl.files.bounded_reading import read_json
from poseppl.files.csv_fields import rows_of_csv
from poseppl.motion.io.motion import Motion, joint_positions, z_up
from poseppl.motion.io.text_parsing import LARGEST, number_rows

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
    rows = _read_rows(path, len(parents))
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


def _read_rows(path: FilePath, num_joints: int) -> Floats:
    of = ("translation", *(f"joint {joint}" for joint in range(num_joints)))
    rows = number_rows(rows_of_csv(path), [f"{name} {axis}" for name in of for axis in "xyz"], 3 * MAX_POINTS)
    if not len(rows):
        raise Location(path).error("no frame", "rows of numbers")
    return rows
