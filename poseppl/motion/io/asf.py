"""The Acclaim skeleton file (ASF): bones with a direction, a length, local axes and degrees of freedom.

A bone b with rest direction d_b (world axes), length l_b and local axes C_b turns by M_b, a rotation about its own axes:

    L_b = C_b M_b C_b^-1,   R_b = R_parent L_b,   p_b = p_parent + l_b R_b d_b,

where p_b is the END of the bone. Euler angles (a, b, c) in the order "XYZ" mean that X turns first: R = R_z(c) R_y(b) R_x(a).
Lengths are in units of 1/length inch, where ``length`` is the value in ``:units`` (0.45 in the CMU database: 56.444 mm a unit).

Source: Acclaim Advanced Technologies Group, ASF/AMC format; CMU Graphics Lab Motion Capture Database, mocap.cs.cmu.edu.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from poseppl.errors import FilePath, Location
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.text_parsing import Line, lines_of_words, parse_number, parse_numbers

MM_PER_INCH = 25.4
MAX_BONES = 500
ROTATIONS = ("rx", "ry", "rz")
TRANSLATIONS = ("tx", "ty", "tz")
_Lines = list[Line]


class Bone(NamedTuple):
    """One bone of a skeleton.

    Attributes:
        name: The bone's name.
        parent: Index of the parent bone in `Skeleton.bones`; -1 for the root itself.
        direction: (3,) unit vector of the bone at rest, in the file's world axes.
        length: Length in mm; 0 for the root.
        axis: (3,) Euler angles of the local axes, in radians.
        axis_order: The order of those and of the motion's rotations, for instance "XYZ": X turns first.
        dof: The channels in the order of the AMC file, "rx", "ry", "rz" (the root has "tx", "ty", "tz" too).
    """

    name: str
    parent: int
    direction: tuple[float, float, float]
    length: float
    axis: tuple[float, float, float]
    axis_order: str
    dof: tuple[str, ...]


class Skeleton(NamedTuple):
    """A skeleton: bones sorted so that a parent precedes its children; the first is the root.

    Attributes:
        bones: The bones.
        mm_per_unit: Millimetres in one unit of length of the file.
        radians_per_unit: Radians in one unit of angle of the file.
        root_position: (3,) mm, added to the root's translation.
        source: The file.
    """

    bones: tuple[Bone, ...]
    mm_per_unit: float
    radians_per_unit: float
    root_position: tuple[float, float, float]
    source: str


def read_asf(path: FilePath) -> Skeleton:
    """Read an ASF skeleton.

    Args:
        path: The .asf file.

    Returns:
        The skeleton, lengths in mm and angles in radians.

    Raises:
        InputError: The file is no ASF, or a section or bone is missing, repeated or malformed.
    """
    sections = _sections(path)
    mm, radians = _units(sections.get("units", []))
    raw, ends = _bones(_need(path, sections, "bonedata"), mm, radians)
    root, position = _root(_need(path, sections, "root"), mm, radians)
    parents = _hierarchy(_need(path, sections, "hierarchy"), set(raw))
    index = {"root": 0}
    bones = [root]
    for name, parent in parents:
        index[name] = len(bones)
        bones.append(raw[name]._replace(parent=index[parent]))
    missing = sorted(set(raw) - set(index))
    if missing:
        raise ends[missing[0]].error(f"bone {missing[0]!r} is in no line of :hierarchy")
    return Skeleton(tuple(bones), mm, radians, position, str(path))


def _sections(path: FilePath) -> dict[str, _Lines]:
    sections: dict[str, _Lines] = {}
    current: _Lines | None = None
    for at, words in lines_of_words(path, re.sub("#.*", "", read_text(path))):
        if words[0].startswith(":"):
            name = words[0][1:].lower()
            if name in sections:
                raise at.error(f"section :{name} is repeated")
            current = sections[name] = []
        elif current is None:
            raise at.error("text before the first section", "an ASF file (:version, ...)")
        else:
            current.append((at, words))
    return sections


def _need(path: FilePath, sections: dict[str, _Lines], name: str) -> _Lines:
    if not sections.get(name):
        raise Location(path).error(f"section :{name} is missing or empty", "an Acclaim skeleton (.asf)")
    return sections[name]


def _units(lines: _Lines) -> tuple[float, float]:
    mm, radians = MM_PER_INCH, math.pi / 180
    for at, words in lines:
        if len(words) != 2:
            continue
        if words[0] == "length":
            value = parse_number(words[1], at.in_field("units length"))
            if not 1e-4 <= value <= 1e4:
                raise at.error(f"unit of length {value:g}", "between 1e-4 and 1e4")
            mm = MM_PER_INCH / value
        elif words[0] == "angle":
            if words[1].lower() not in ("deg", "rad"):
                raise at.error(f"unit of angle {words[1]!r}", "deg or rad")
            radians = 1.0 if words[1].lower() == "rad" else radians
    return mm, radians


def _three(at: Location, words: list[str], field: str) -> tuple[float, float, float]:
    if len(words) != 3:
        raise at.in_field(field).error(f"{len(words)} values", "3 numbers")
    x, y, z = parse_numbers(words, at.in_field(field))
    return x, y, z


def _axis_order(at: Location, word: str) -> str:
    if sorted(word.upper()) != ["X", "Y", "Z"]:
        raise at.in_field("axis").error(f"axis order {word!r}", "a permutation of XYZ")
    return word.upper()


def _channels(at: Location, words: list[str], allowed: tuple[str, ...]) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words)
    for channel in channels:
        if channel not in allowed:
            raise at.error(f"channel {channel!r} is not supported", " ".join(allowed))
    if len(set(channels)) != len(channels):
        raise at.in_field("dof").error("a channel is repeated")
    return channels


def _root(lines: _Lines, mm: float, radians: float) -> tuple[Bone, tuple[float, float, float]]:
    channels: tuple[str, ...] = ()
    order, position, axis = "XYZ", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for at, words in lines:
        if words[0] == "order":
            channels = _channels(at, words[1:], TRANSLATIONS + ROTATIONS)
        elif words[0] == "axis":
            order = _axis_order(at, "".join(words[1:]))
        elif words[0] == "position":
            x, y, z = _three(at, words[1:], "root position")
            position = (x * mm, y * mm, z * mm)
        elif words[0] == "orientation":
            x, y, z = _three(at, words[1:], "root orientation")
            axis = (x * radians, y * radians, z * radians)
    if sorted(channels) != sorted(TRANSLATIONS + ROTATIONS):
        raise lines[0][0].error("the root's order is incomplete", "TX TY TZ RX RY RZ")
    return Bone("root", -1, (0.0, 0.0, 0.0), 0.0, axis, order, channels), position


def _bones(lines: _Lines, mm: float, radians: float) -> tuple[dict[str, Bone], dict[str, Location]]:
    bones: dict[str, Bone] = {}
    ends: dict[str, Location] = {}
    block: _Lines | None = None
    for at, words in lines:
        if words[0] == "begin":
            if block is not None:
                raise at.error("begin inside a bone", "end of the bone before")
            block = []
        elif words[0] == "end":
            if not block:
                raise at.error("end of no bone, or of an empty one")
            bone = _bone(block, mm, radians)
            if bone.name in bones or bone.name == "root":
                raise at.error(f"bone {bone.name!r} is repeated")
            bones[bone.name], ends[bone.name], block = bone, at, None
        elif block is not None:
            block.append((at, words))
        else:
            raise at.error(f"{words[0]!r} outside a bone", "begin")
        if len(bones) > MAX_BONES:
            raise at.error(f"more than {MAX_BONES} bones")
    if block is not None:
        raise lines[-1][0].error("the file ends inside a bone", "end")
    return bones, ends


def _bone(block: _Lines, mm: float, radians: float) -> Bone:
    fields = {words[0]: (at, words[1:]) for at, words in block}
    start = block[0][0]
    for field in ("name", "direction", "length", "axis"):
        if not fields.get(field, (start, []))[1]:
            raise start.in_field(field).error("a bone lacks this line")
    name = fields["name"][1][0]
    direction = _three(*fields["direction"], f"{name} direction")
    norm = sum(x * x for x in direction) ** 0.5
    if not 0.9 < norm < 1.1:
        raise fields["direction"][0].in_field(f"{name} direction").error(f"length {norm:g}", "1")
    at, words = fields["length"]
    length = parse_number(words[0], at.in_field(f"{name} length"))
    if length < 0:
        raise at.in_field(f"{name} length").error("negative", "0 or more")
    at, words = fields["axis"]
    order = _axis_order(at, "".join(words[3:]))
    x, y, z = _three(at, words[:3], f"{name} axis")
    dof = _channels(*fields.get("dof", (start, [])), ROTATIONS)
    unit = (direction[0] / norm, direction[1] / norm, direction[2] / norm)
    return Bone(name, -1, unit, length * mm, (x * radians, y * radians, z * radians), order, dof)


def _hierarchy(lines: _Lines, known: set[str]) -> list[tuple[str, str]]:
    placed = {"root"}
    edges: list[tuple[str, str]] = []
    for at, words in lines:
        if words in (["begin"], ["end"]):
            continue
        parent, *children = words
        if parent not in placed:
            raise at.in_field("hierarchy").error(f"{parent!r} is named before its parent")
        for child in children:
            if child not in known:
                raise at.in_field("hierarchy").error(f"{child!r} is not in :bonedata")
            if child in placed:
                raise at.in_field("hierarchy").error(f"{child!r} has two parents")
            placed.add(child)
            edges.append((child, parent))
    return edges
