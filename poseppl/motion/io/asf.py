"""The Acclaim skeleton file (ASF): bones with a direction, a length, local axes and degrees of freedom.

A bone b with rest direction d_b (world axes), length l_b and local axes C_b turns by M_b, a rotation about its own axes:

    L_b = C_b M_b C_b^-1,   R_b = R_parent L_b,   p_b = p_parent + l_b R_b d_b,

where p_b is the END of the bone. Euler angles (a, b, c) in the order "XYZ" mean that X turns first: R = R_z(c) R_y(b) R_x(a).
Lengths are in units of 1/length inch, where ``length`` is the value in ``:units`` (0.45 in the CMU database: 56.444 mm a unit).

Source: Acclaim Advanced Technologies Group, ASF/AMC format; CMU Graphics Lab Motion Capture Database, mocap.cs.cmu.edu.
"""

from __future__ import annotations

import re
from os import PathLike
from typing import NamedTuple

from poseppl.errors import InputError
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.text_parsing import parse_number, parse_numbers, split_words

MM_PER_INCH = 25.4
MAX_BONES = 500
ROTATIONS = ("rx", "ry", "rz")
TRANSLATIONS = ("tx", "ty", "tz")
_Lines = list[tuple[int, list[str]]]


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
        limits: (lower, upper) of each rotation channel in radians; empty where the file gives none.
    """

    name: str
    parent: int
    direction: tuple[float, float, float]
    length: float
    axis: tuple[float, float, float]
    axis_order: str
    dof: tuple[str, ...]
    limits: tuple[tuple[float, float], ...]


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


def read_asf(path: str | PathLike[str]) -> Skeleton:
    """Read an ASF skeleton.

    Args:
        path: The .asf file.

    Returns:
        The skeleton, lengths in mm and angles in radians.

    Raises:
        InputError: The file is no ASF, or a section or bone is missing, repeated or malformed.
    """
    sections = _sections(path)
    mm, radians = _units(path, sections.get("units", []))
    raw, ends = _bones(path, _need(path, sections, "bonedata"), mm, radians)
    root, position = _root(path, _need(path, sections, "root"), mm, radians)
    parents = _hierarchy(path, _need(path, sections, "hierarchy"), set(raw), ends)
    index = {"root": 0}
    bones = [root]
    for name, parent in parents:
        index[name] = len(bones)
        bones.append(raw[name]._replace(parent=index[parent]))
    missing = sorted(set(raw) - set(index))
    if missing:
        raise InputError(f"bone {missing[0]!r} is in no line of :hierarchy", file=path, line=ends[missing[0]])
    return Skeleton(tuple(bones), mm, radians, position, str(path))


def _sections(path: str | PathLike[str]) -> dict[str, _Lines]:
    sections: dict[str, _Lines] = {}
    current: _Lines | None = None
    for line, text in enumerate(read_text(path).split("\n"), start=1):
        words = split_words(text.split("#", 1)[0], file=path, line=line)
        if not words:
            continue
        if words[0].startswith(":"):
            name = words[0][1:].lower()
            if name in sections:
                raise InputError(f"section :{name} is repeated", file=path, line=line)
            current = sections[name] = []
        elif current is None:
            raise InputError("text before the first section", file=path, line=line, expected="an ASF file (:version, ...)")
        else:
            current.append((line, words))
    return sections


def _need(path: str | PathLike[str], sections: dict[str, _Lines], name: str) -> _Lines:
    if not sections.get(name):
        raise InputError(f"section :{name} is missing or empty", file=path, expected="an Acclaim skeleton (.asf)")
    return sections[name]


def _units(path: str | PathLike[str], lines: _Lines) -> tuple[float, float]:
    mm, radians = MM_PER_INCH, 3.141592653589793 / 180.0
    for line, words in lines:
        if len(words) != 2:
            continue
        if words[0] == "length":
            value = parse_number(words[1], file=path, line=line, field="units length")
            if not 1e-4 <= value <= 1e4:
                raise InputError(f"unit of length {value:g}", file=path, line=line, expected="between 1e-4 and 1e4")
            mm = MM_PER_INCH / value
        elif words[0] == "angle":
            if words[1].lower() not in ("deg", "rad"):
                raise InputError(f"unit of angle {words[1]!r}", file=path, line=line, expected="deg or rad")
            radians = 1.0 if words[1].lower() == "rad" else radians
    return mm, radians


def _three(path: str | PathLike[str], line: int, words: list[str], field: str) -> tuple[float, float, float]:
    if len(words) != 3:
        raise InputError(f"{len(words)} values", file=path, line=line, field=field, expected="3 numbers")
    x, y, z = parse_numbers(words, file=path, line=line, field=field)
    return x, y, z


def _axis_order(path: str | PathLike[str], line: int, word: str) -> str:
    if sorted(word.upper()) != ["X", "Y", "Z"]:
        raise InputError(f"axis order {word!r}", file=path, line=line, field="axis", expected="a permutation of XYZ")
    return word.upper()


def _channels(path: str | PathLike[str], line: int, words: list[str], allowed: tuple[str, ...]) -> tuple[str, ...]:
    channels = tuple(word.lower() for word in words)
    for channel in channels:
        if channel not in allowed:
            raise InputError(f"channel {channel!r} is not supported", file=path, line=line, expected=" ".join(allowed))
    if len(set(channels)) != len(channels):
        raise InputError("a channel is repeated", file=path, line=line, field="dof")
    return channels


def _root(path: str | PathLike[str], lines: _Lines, mm: float, radians: float) -> tuple[Bone, tuple[float, float, float]]:
    channels: tuple[str, ...] = ()
    order, position, axis = "XYZ", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for line, words in lines:
        if words[0] == "order":
            channels = _channels(path, line, words[1:], TRANSLATIONS + ROTATIONS)
        elif words[0] == "axis":
            order = _axis_order(path, line, "".join(words[1:]))
        elif words[0] == "position":
            x, y, z = _three(path, line, words[1:], "root position")
            position = (x * mm, y * mm, z * mm)
        elif words[0] == "orientation":
            x, y, z = _three(path, line, words[1:], "root orientation")
            axis = (x * radians, y * radians, z * radians)
    if sorted(channels) != sorted(TRANSLATIONS + ROTATIONS):
        raise InputError("the root's order is incomplete", file=path, line=lines[0][0], expected="TX TY TZ RX RY RZ")
    return Bone("root", -1, (0.0, 0.0, 0.0), 0.0, axis, order, channels, ()), position


def _bones(path: str | PathLike[str], lines: _Lines, mm: float, radians: float) -> tuple[dict[str, Bone], dict[str, int]]:
    bones: dict[str, Bone] = {}
    ends: dict[str, int] = {}
    block: _Lines | None = None
    for line, words in lines:
        if words[0] == "begin":
            if block is not None:
                raise InputError("begin inside a bone", file=path, line=line, expected="end of the bone before")
            block = []
        elif words[0] == "end":
            if not block:
                raise InputError("end of no bone, or of an empty one", file=path, line=line)
            bone = _bone(path, block, mm, radians)
            if bone.name in bones or bone.name == "root":
                raise InputError(f"bone {bone.name!r} is repeated", file=path, line=line)
            bones[bone.name], ends[bone.name], block = bone, line, None
        elif block is not None:
            block.append((line, words))
        else:
            raise InputError(f"{words[0]!r} outside a bone", file=path, line=line, expected="begin")
        if len(bones) > MAX_BONES:
            raise InputError(f"more than {MAX_BONES} bones", file=path, line=line)
    if block is not None:
        raise InputError("the file ends inside a bone", file=path, line=lines[-1][0], expected="end")
    return bones, ends


def _bone(path: str | PathLike[str], block: _Lines, mm: float, radians: float) -> Bone:
    fields: dict[str, tuple[int, list[str]]] = {}
    limits: list[tuple[float, float]] = []
    in_limits = False
    for line, words in block:
        in_limits = words[0] == "limits" or (in_limits and words[0].startswith("("))
        if in_limits:
            limits.append(_limit(path, line, words, radians))
        else:
            fields[words[0]] = (line, words[1:])
    start = block[0][0]
    for field in ("name", "direction", "length", "axis"):
        if not fields.get(field, (0, []))[1]:
            raise InputError("a bone lacks this line", file=path, line=start, field=field)
    name = fields["name"][1][0]
    direction = _three(path, *fields["direction"], f"{name} direction")
    norm = sum(x * x for x in direction) ** 0.5
    if not 0.9 < norm < 1.1:
        raise InputError(f"length {norm:g}", file=path, line=fields["direction"][0], field=f"{name} direction", expected="1")
    line, words = fields["length"]
    length = parse_number(words[0], file=path, line=line, field=f"{name} length")
    if length < 0:
        raise InputError("negative", file=path, line=line, field=f"{name} length", expected="0 or more")
    line, words = fields["axis"]
    order = _axis_order(path, line, "".join(words[3:]))
    x, y, z = _three(path, line, words[:3], f"{name} axis")
    dof = _channels(path, *fields.get("dof", (start, [])), ROTATIONS)
    if limits and len(limits) != len(dof):
        raise InputError(f"{len(limits)} limits for {len(dof)} dof", file=path, line=start, field=f"{name} limits")
    unit = (direction[0] / norm, direction[1] / norm, direction[2] / norm)
    return Bone(name, -1, unit, length * mm, (x * radians, y * radians, z * radians), order, dof, tuple(limits))


def _limit(path: str | PathLike[str], line: int, words: list[str], radians: float) -> tuple[float, float]:
    text = " ".join(words).removeprefix("limits").strip()
    found = re.fullmatch(r"\(\s*([^\s()]+)\s+([^\s()]+)\s*\)", text)
    if not found:
        raise InputError(f"{text[:40]!r}", file=path, line=line, field="limits", expected="(lower upper)")
    bounds = []
    for token, infinite in zip(found.groups(), ("-inf", "inf"), strict=True):
        known = token.lower() == infinite
        bounds.append(float(infinite) if known else parse_number(token, file=path, line=line, field="limits") * radians)
    if bounds[0] > bounds[1]:
        raise InputError("lower above upper", file=path, line=line, field="limits", expected="(lower upper)")
    return bounds[0], bounds[1]


def _hierarchy(path: str | PathLike[str], lines: _Lines, known: set[str], ends: dict[str, int]) -> list[tuple[str, str]]:
    placed = {"root"}
    edges: list[tuple[str, str]] = []
    for line, words in lines:
        if words in (["begin"], ["end"]):
            continue
        parent, *children = words
        if parent not in placed:
            raise InputError(f"{parent!r} is named before its parent", file=path, line=line, field="hierarchy")
        for child in children:
            if child not in known:
                raise InputError(f"{child!r} is not in :bonedata", file=path, line=line, field="hierarchy")
            if child in placed:
                raise InputError(f"{child!r} has two parents", file=path, line=line, field="hierarchy")
            placed.add(child)
            edges.append((child, parent))
    return edges
