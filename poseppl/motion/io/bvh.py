"""BioVision hierarchy (BVH) recordings, read and written.

    p_child = p_parent + R_parent t_child,    R_child = R_parent Q_child,    Q = the product of the rotations as listed.

t is a joint's OFFSET, or what its position channels say where it has some, as studios export bones that stretch or slide.

The format states no unit of length. The database of Carnegie Mellon in this format keeps the unit of its ASF skeletons, 1/0.45
inch = 56.444 mm; others write inches, centimetres, decimetres (MakeHuman) or metres. Without a scale the unit is taken that
brings the height of the skeleton at rest closest to 1.65 m, by ratio: right for adults, whose joints span 1.3 to 2 m.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Location, Phrase, brief
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_text
from poseppl.files.csv_fields import Line
from poseppl.motion.io.motion import Motion, joint_positions, z_up
from poseppl.motion.io.text_parsing import lines_of_words, number_rows, parse_number, parse_numbers
from poseppl.motion.io.units_and_axes import vertical_axis

_UNITS_BY_RANK = (1.0, 10.0, 25.4, 25.4 / 0.45, 100.0, 1000.0)
TYPICAL_HEIGHT_MM = 1650.0
MAX_JOINTS = 500
MAX_POINTS = 5_000_000


@dataclass
class _Joint:
    """A joint, or the end of a limb: its place in the hierarchy, and the columns of its channels by name, as listed."""

    name: str
    parent: int
    at: Location
    end: bool
    offset: list[float] | None = None
    columns: dict[str, int] = field(default_factory=dict)

    def positions(self, values: Floats) -> Floats | None:
        """Values of its position channels, (T, 3); None if it has none."""
        columns = [self.columns[name] for name in ("Xposition", "Yposition", "Zposition") if name in self.columns]
        return values[:, columns] if columns else None

    def rotations(self, values: Floats) -> Rotation:
        """Rotations of its rotation channels, T."""
        columns = {name[0]: column for name, column in self.columns.items() if name.endswith("rotation")}
        if not columns:
            return Rotation.identity(len(values))
        return Rotation.from_euler("".join(columns), np.deg2rad(values[:, list(columns.values())]))


def read_bvh(path: FilePath, *, scale: float | None = None, up: str | None = None) -> Motion:
    """Read a BVH recording.

    Args:
        path: The .bvh file; each joint with three rotation channels, the root with three position channels besides,
            other joints with or without.
        scale: Millimetres in one unit of length; guessed by default (see the module), and then named in ``notes``.
        up: The axis that points up; by default the one along which the head is above the feet.

    Returns:
        The motion, Z up, in mm: joints and end sites ("NAME_end").

    Raises:
        InputError: The file is malformed, holds a value that is not finite, or has no height to guess the scale from.
    """
    if scale is not None and not 1e-6 <= scale <= 1e6:
        raise InputError(f"{scale:g} mm a unit", field="scale", expected="a positive number")
    lines = lines_of_words(path, read_text(path))
    joints = _read_hierarchy(path, lines)
    values, rate = _read_motion(path, lines, joints)
    names, parents = tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints)
    moved = [joint.positions(values) for joint in joints]
    offsets = [np.array(joint.offset) if own is None else own for joint, own in zip(joints, moved, strict=True)]
    points = joint_positions(parents, offsets, [joint.rotations(values) for joint in joints], offsets[0])
    still = [np.median(offset, axis=0) if offset.ndim == 2 else offset for offset in offsets]
    rest = joint_positions(parents, still, [Rotation.identity()] * len(joints), np.zeros((1, 3)))[0]
    vertical = vertical_axis(names, points, given=up, rest=rest, usual="y", kind="BVH files")
    notes = [vertical.note()]
    if scale is None:
        scale = _guess_scale(path, float(np.ptp(rest[:, "xyz".index(vertical.axis[-1])])))
        taken = f"1 unit is taken as {scale:.4g} mm, from the height at rest. "
        notes.append(Phrase(taken, Argument("scale"), " sets another"))
    return Motion(names, z_up(points * scale, vertical.axis), parents, rate, str(path), tuple(notes))


def _guess_scale(path: FilePath, height: float) -> float:
    if not height > 1e-6:
        raise Location(path, field="scale").error("the skeleton has no height to guess its unit from", "mm a unit")
    return min(_UNITS_BY_RANK, key=lambda unit: abs(math.log(unit * height / TYPICAL_HEIGHT_MM)))


def _read_hierarchy(path: FilePath, lines: Iterator[Line]) -> list[_Joint]:
    """The joints in order; what is left of the lines comes after MOTION."""
    at = Location(path)
    if next(lines, (None, [""]))[1][0] != "HIERARCHY":
        raise at.in_line(1).error("no HIERARCHY", "a BioVision recording (.bvh)")
    joints: list[_Joint] = []
    opened: list[int] = []
    for here, words in lines:
        key, rest = words[0], words[1:]
        if key == "MOTION":
            break
        if key in ("ROOT", "JOINT", "End"):
            joints.append(_joint(here, key, rest, joints, opened))
            if next(lines, (here, []))[1] != ["{"]:
                raise here.in_field(key).error("no { in the line after it", "{, what it holds, and }")
            opened.append(len(joints) - 1)
        elif key in ("OFFSET", "CHANNELS") and opened:
            _set(here.in_field(key), joints, joints[opened[-1]], rest)
        elif words == ["}"] and opened:
            opened.pop()
        else:
            raise here.error("a } too many" if words == ["}"] else f"{brief(key)} is no part of a hierarchy")
    else:
        raise at.error("no MOTION section; is the file truncated?")
    if opened or not joints:
        raise at.error("the hierarchy is not closed" if opened else "the hierarchy is empty")
    for joint in joints:
        if joint.offset is None or not (joint.columns or joint.end):
            raise joint.at.error(f"{brief(joint.name)} lacks its OFFSET or its CHANNELS")
    return joints


def _joint(at: Location, key: str, rest: list[str], joints: list[_Joint], opened: list[int]) -> _Joint:
    if (key == "ROOT") != (not joints) or (joints and not opened):
        raise at.in_field(key).error("a joint beside the root", "one ROOT, which contains each JOINT and End Site")
    if len(joints) == MAX_JOINTS:
        raise at.error(f"more than {MAX_JOINTS} joints")
    end, parent = key == "End", opened[-1] if opened else -1
    if not end and (len(rest) != 1 or rest[0] in [joint.name for joint in joints if not joint.end]):
        raise at.in_field(key).error("a joint without one name of its own", "NAME")
    name = f"{joints[parent].name}_end" if end else rest[0]
    while name in [joint.name for joint in joints]:
        name += "_"
    return _Joint(name, parent, at, end)


def _set(at: Location, joints: list[_Joint], joint: _Joint, words: list[str]) -> None:
    """Set the offset or the channels of a joint."""
    if joint.columns if at.field == "CHANNELS" else joint.offset:
        raise at.error(f"{brief(joint.name)} has two", "one")
    if at.field == "OFFSET":
        if len(words) != 3:
            raise at.error(f"{len(words)} values", "3 numbers")
        joint.offset = parse_numbers(words, at)
        return
    if joint.end:
        raise at.error("the end of a limb has no channels", "them in its JOINT")
    if not words or words[0] != str(len(words) - 1):
        raise at.error("the count differs from the list")
    first = sum(len(other.columns) for other in joints)
    joint.columns = {word[:1].upper() + word[1:].lower(): first + number for number, word in enumerate(words[1:])}
    for kind in ("position", "rotation"):
        axes = sorted(name.removesuffix(kind) for name in joint.columns if name.endswith(kind))
        free = kind == "position" and joint.parent >= 0
        if axes != ["X", "Y", "Z"] and not (free and not axes):
            problem = f"{kind} channels {', '.join(axes)} of {brief(joint.name)}"
            raise at.error(problem, "X, Y and Z, or none" if free else "X, Y and Z")


def _read_motion(path: FilePath, lines: Iterator[Line], joints: list[_Joint]) -> tuple[Floats, float]:
    """Values (T, channels), and frames a second."""
    heads = list(itertools.islice(lines, 2))
    if [words[: 1 + i] for i, (_, words) in enumerate(heads)] != [["Frames:"], ["Frame", "Time:"]]:
        raise (heads[0][0] if heads else Location(path)).error("no lines Frames: and Frame Time: after MOTION")
    (at, frames), (at_time, time) = heads
    if len(frames) != 2 or not frames[1].isascii() or not frames[1].isdigit() or len(frames[1]) > 9:
        raise at.in_field("Frames:").error("no number of frames", "a whole number")
    at_time = at_time.in_field("Frame Time:")
    seconds = parse_number(" ".join(time[2:]), at_time)
    if not 1e-5 <= seconds <= 100.0:
        raise at_time.error(f"{seconds:g} s", "a positive time in s")
    names = {column: f"{joint.name} {name}" for joint in joints for name, column in joint.columns.items()}
    values = number_rows(lines, [names[column] for column in sorted(names)], MAX_POINTS // len(joints) * len(names))
    if len(values) != int(frames[1]) or not len(values):
        raise Location(path).error(f"{len(values)} frames; is the file truncated?", f"{frames[1]}, as in Frames:")
    whole = round(1 / seconds)  # most files have six digits of the time: 0.033333 for 30 frames a second
    rate = float(whole) if whole and abs(1 / whole - seconds) < 1e-4 * seconds else 1 / seconds
    return values, rate


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
        lines.extend([f"{pad}  OFFSET {_decimals(joint.offset / scale)}", f"{pad}  CHANNELS {channels}"])
        for child, other in enumerate(joints):
            if other.parent == index:
                write(child, depth + 1)
        for end in joint.ends:
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_decimals(end / scale)}", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    write(0, 0)
    angles = Rotation.from_matrix(turns[:, order].reshape(-1, 3, 3)).as_euler("ZXY", degrees=True)
    rows = np.concatenate([root / scale, angles.reshape(len(turns), -1)], 1)
    lines += ["MOTION", f"Frames: {len(rows)}", f"Frame Time: {1 / rate:.9g}", *map(_decimals, rows)]
    write_atomically(path, "\n".join(lines) + "\n")


def _decimals(values: Floats) -> str:
    return " ".join(f"{value:.6f}" for value in values)
