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

from poseppl.errors import FilePath, Location, brief
from poseppl.files.bounded_reading import read_text
from poseppl.files.csv_fields import Line
from poseppl.motion.io.text_parsing import lines_of_words, parse_number, parse_numbers

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
        raise ends[missing[0]].error(f"bone {brief(missing[0])} is in no line of :hierarchy")
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


def _fields(lines: _Lines, name: str = "") -> dict[str, Line]:
    """The rest of each line after its first word, by that word."""
    return {words[0]: (at.in_field(f"{name} {words[0]}".strip()), words[1:]) for at, words in lines}


def _units(lines: _Lines) -> tuple[float, float]:
    """Mm and radians of a unit."""
    fields = {"length": (Location(), ["1"]), "angle": (Location(), ["deg"])} | _fields(lines, "units")
    (at, length), (at_angle, angle) = ((at, " ".join(words)) for at, words in (fields["length"], fields["angle"]))
    value = parse_number(length, at)
    if not 1e-4 <= value <= 1e4:
        raise at.error(f"unit of length {value:g}", "between 1e-4 and 1e4")
    if angle.lower() not in ("deg", "rad"):
        raise at_angle.error(f"unit of angle {brief(angle)}", "deg or rad")
    return MM_PER_INCH / value, 1.0 if angle.lower() == "rad" else math.pi / 180


def _three(at: Location, words: list[str], unit: float = 1.0) -> tuple[float, float, float]:
    if len(words) != 3:
        raise at.error(f"{len(words)} values", "3 numbers")
    x, y, z = parse_numbers(words, at)
    return x * unit, y * unit, z * unit


def _axis_order(at: Location, words: list[str]) -> str:
    order = "".join(words).upper()
    if sorted(order) != ["X", "Y", "Z"]:
        raise at.error(f"axis order {brief(order)}", "a permutation of XYZ")
    return order


def _channels(at: Location, words: list[str], allowed: tuple[str, ...]) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words)
    for channel in channels:
        if channel not in allowed:
            raise at.error(f"channel {brief(channel)} is not supported", " ".join(allowed))
    if len(set(channels)) != len(channels):
        raise at.error("a channel is repeated")
    return channels


def _root(lines: _Lines, mm: float, radians: float) -> tuple[Bone, tuple[float, float, float]]:
    """The root, and its position in mm."""
    still = Location(), ["0"] * 3
    defaults = {"order": (Location(), []), "axis": (Location(), ["XYZ"]), "position": still, "orientation": still}
    fields = defaults | _fields(lines, "root")
    channels = _channels(*fields["order"], TRANSLATIONS + ROTATIONS)
    if len(channels) < len(TRANSLATIONS + ROTATIONS):
        raise lines[0][0].error("the root's order is incomplete", "TX TY TZ RX RY RZ")
    axis, order = _three(*fields["orientation"], radians), _axis_order(*fields["axis"])
    return Bone("root", -1, (0.0, 0.0, 0.0), 0.0, axis, order, channels), _three(*fields["position"], mm)


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
                raise at.error(f"bone {brief(bone.name)} is repeated")
            bones[bone.name], ends[bone.name], block = bone, at, None
        elif block is not None:
            block.append((at, words))
        else:
            raise at.error(f"{brief(words[0])} outside a bone", "begin")
        if len(bones) > MAX_BONES:
            raise at.error(f"more than {MAX_BONES} bones")
    if block is not None:
        raise lines[-1][0].error("the file ends inside a bone", "end")
    return bones, ends


def _bone(block: _Lines, mm: float, radians: float) -> Bone:
    start = block[0][0]
    name = " ".join(_fields(block).get("name", (start, []))[1][:1])
    fields: dict[str, Line] = {"dof": (start, []), **_fields(block, name)}
    for field in ("name", "direction", "length", "axis"):
        if not fields.get(field, (start, []))[1]:
            raise start.in_field(field).error("a bone lacks this line")
    direction = _three(*fields["direction"])
    norm = sum(x * x for x in direction) ** 0.5
    if not 0.9 < norm < 1.1:
        raise fields["direction"][0].error(f"length {norm:g}", "1")
    at, words = fields["length"]
    length = parse_number(words[0], at)
    if length < 0:
        raise at.error("negative", "0 or more")
    at, words = fields["axis"]
    axis, order = _three(at, words[:3], radians), _axis_order(at, words[3:])
    unit = (direction[0] / norm, direction[1] / norm, direction[2] / norm)
    return Bone(name, -1, unit, length * mm, axis, order, _channels(*fields["dof"], ROTATIONS))


def _hierarchy(lines: _Lines, known: set[str]) -> list[tuple[str, str]]:
    placed = {"root"}
    edges: list[tuple[str, str]] = []
    for at, words in lines:
        if words in (["begin"], ["end"]):
            continue
        parent, *children = words
        if parent not in placed:
            raise at.in_field("hierarchy").error(f"{brief(parent)} is named before its parent")
        for child in children:
            if child not in known:
                raise at.in_field("hierarchy").error(f"{brief(child)} is not in :bonedata")
            if child in placed:
                raise at.in_field("hierarchy").error(f"{brief(child)} has two parents")
            placed.add(child)
            edges.append((child, parent))
    return edges
