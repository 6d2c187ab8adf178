"""BVH recordings (:mod:`poseppl.motion.io.bvh`), written: a hierarchy of joints, and their turns over time; Y up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import FilePath
from poseppl.files.atomic_writing import write_atomically

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
"""Units of length by name, mm."""
_CHANNELS = "Zrotation Xrotation Yrotation"


class BvhJoint(NamedTuple):
    """A joint.

    Attributes:
        name: Its name, without white space.
        parent: Index of the joint above, which comes first; -1 for the root.
        offset: From the joint above (3,), mm, Y up.
        ends: Offsets (3,) of the limb's ends, mm, Y up.
    """

    name: str
    parent: int
    offset: Floats
    ends: Sequence[Floats] = ()


def write_bvh(path: FilePath, joints: Sequence[BvhJoint], turns: Floats, root: Floats, rate: float, unit: str = "cm") -> None:
    """Write a motion.

    Args:
        path: The .bvh file, overwritten if it exists.
        joints: J joints, the root first.
        turns: (T, J, 3, 3) rotations of each joint relative to the one above, Y up.
        root: (T, 3) places of the root, mm, Y up.
        rate: Frames a second.
        unit: Unit of lengths in the file: "mm", "cm" or "m".

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    scale, lines, order = UNITS_MM[unit], ["HIERARCHY"], list[int]()

    def write(index: int, depth: int) -> None:
        joint, pad = joints[index], "  " * depth
        order.append(index)
        channels = f"6 Xposition Yposition Zposition {_CHANNELS}" if joint.parent < 0 else f"3 {_CHANNELS}"
        lines.extend([f"{pad}{'ROOT' if joint.parent < 0 else 'JOINT'} {joint.name}", f"{pad}{{"])
        lines.extend([f"{pad}  OFFSET {_numbers(joint.offset / scale)}", f"{pad}  CHANNELS {channels}"])
        for child, other in enumerate(joints):
            if other.parent == index:
                write(child, depth + 1)
        for end in joint.ends:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_numbers(end / scale)}", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    write(0, 0)
    angles = Rotation.from_matrix(turns[:, order].reshape(-1, 3, 3)).as_euler("ZXY", degrees=True)
    rows = np.concatenate([root / scale, angles.reshape(len(turns), -1)], 1)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / rate:.9g}", *map(_numbers, rows)]
    write_atomically(path, "\n".join(lines) + "\n")


def _numbers(values: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in values)
