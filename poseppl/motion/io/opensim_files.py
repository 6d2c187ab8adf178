"""OpenSim's files: joint angles over time (.mot), read and written, and models (.osim), written.

A motion file has a header that ends in ``endheader``, then a row a frame.

    Coordinates
    version=1
    nRows=131
    nColumns=3
    inDegrees=yes

    Units are S.I. units (second, meters, Newtons, ...)
    endheader
    time  knee_angle_r  pelvis_tx
    0.00  12.5          0.31

Columns are separated by white space or by commas. Rotations are in degrees where the header says so, else in radians; what else
the header holds is text.

A model has segments of a person's lengths, joints with coordinates, and markers: a tree of rigid bodies. Each joint is a
CustomJoint whose coordinates turn about Z, X and Y, as in OpenSim's full-body models, and so it moves as a ``.mot`` says.
There are no muscles, and masses are shares of the body's mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, Location, brief
from poseppl.files.atomic_writing import write_atomically
from poseppl.files.bounded_reading import read_text
from poseppl.motion.io.text_parsing import LONGEST, check_distinct, number_rows
from poseppl.motion.io.trc import column_name

MAX_COLUMNS = 10_000
MAX_VALUES = 40_000_000


class MotionFile(NamedTuple):
    """Content of a motion file.

    Attributes:
        times: (T,) seconds.
        columns: (T,) each, by name; metres and, as `in_degrees` says, degrees or radians.
        in_degrees: The unit of rotations.
    """

    times: Floats
    columns: Mapping[str, Floats]
    in_degrees: bool


def write_mot(path: FilePath, times: Floats, columns: Mapping[str, Floats], notes: Sequence[str] = ()) -> None:
    """Write coordinates, rotations of which are in degrees.

    Args:
        path: The .mot file, overwritten if it exists.
        times: (T,) seconds, ascending.
        columns: (T,) each, degrees or metres, by the names of the coordinates.
        notes: Lines for the header, such as what each column means.

    Raises:
        InputError: A value is not finite, a name cannot stand in the file, or the file cannot be written.
        PosepplError: The disk is full.
    """
    for name, values in columns.items():
        if not np.isfinite(values).all():
            frame = int(np.flatnonzero(~np.isfinite(values))[0])
            raise Location(path).error(f"{name} is not finite at {times[frame]:g} s", "numbers in every frame")
    header = [
        "Coordinates",
        "version=1",
        f"nRows={len(times)}",
        f"nColumns={1 + len(columns)}",
        "inDegrees=yes",
        "",
        "Units are S.I. units (second, meters, Newtons, ...)",
        "Angles are in degrees.",
        *(" ".join(note.split()).replace("=", "is") for note in notes),  # OpenSim takes what has a = for a setting
        "endheader",
        "\t".join(["time", *(column_name(name, path) for name in columns)]),
    ]
    rows = np.column_stack([times, *columns.values()]).tolist()
    body = ["\t".join([f"{time:.9g}", *(f"{value:.8f}" for value in row)]) for time, *row in rows]
    write_atomically(path, "\n".join([*header, *body]) + "\n")


def read_mot(path: FilePath) -> MotionFile:
    """Read a motion file, OpenSim's or ours.

    Raises:
        InputError: The file has no header or no rows, or something in it is no finite number.
    """
    at, lines = Location(path), read_text(path).split("\n")
    ends = [number for number, line in enumerate(lines) if line.strip().strip(",").lower() == "endheader"]
    if not ends or len(lines) < ends[0] + 3:
        raise at.error("no line endheader with columns after it", "a motion file of OpenSim")
    known = dict(line.strip().strip(",").partition("=")[::2] for line in lines[: ends[0]])
    names = _fields(lines[ends[0] + 1])
    here = at.in_line(ends[0] + 2)
    if names[:1] != ["time"] or not 1 < len(names) <= MAX_COLUMNS or max(map(len, names)) > LONGEST:
        raise here.error(f"{len(names)} columns, the first {brief(names[:1])}", f"time, and 1 to {MAX_COLUMNS} others")
    check_distinct(names, "columns", here)
    rows = ((at.in_line(number), _fields(line)) for number, line in enumerate(lines[ends[0] + 2 :], start=ends[0] + 3))
    table = number_rows((line for line in rows if line[1]), names, MAX_VALUES)
    if not len(table):
        raise at.error("no frame", "rows of numbers after the header")
    times, *values = table.T
    return MotionFile(times, dict(zip(names[1:], values, strict=True)), known.get("inDegrees", "no").strip().lower() == "yes")


def _fields(line: str) -> list[str]:
    return [field.strip() for field in line.split(",")] if "," in line else line.split()


VERSION = "40000"
_AXES = ("0 0 1", "1 0 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1")
"""Axes of a CustomJoint's six motions: rotations about Z, X and Y, and translations along X, Y and Z."""


class OsimSegment(NamedTuple):
    """A body and the joint that carries it.

    Attributes:
        name: Its name.
        parent: That of the body above; "ground" of the root.
        place: Position of the joint in the parent's frame, m: forward, up, right.
        turns: Names of the coordinates about Z, X and Y, as many as the joint has; negative angles where a sign is -1.
        signs: Signs of each of these.
        moves: Names of the coordinates along X, Y and Z; of the root.
        mass: Share of the body's mass.
    """

    name: str
    parent: str
    place: tuple[float, float, float]
    turns: Sequence[str]
    signs: Sequence[int]
    moves: Sequence[str] = ()
    mass: float = 0.0


class OsimMarker(NamedTuple):
    """A marker: its name, its body, and its place there, m: forward, up, right."""

    name: str
    segment: str
    place: tuple[float, float, float]


def write_osim(
    path: FilePath, name: str, segments: Sequence[OsimSegment], markers: Sequence[OsimMarker], mass: float = 75.0
) -> None:
    """Write a model.

    Args:
        path: The .osim file, overwritten if it exists.
        name: Name of the model.
        segments: Parents before their children.
        markers: Its markers.
        mass: Mass of the whole body, kg.

    Raises:
        InputError: The file cannot be written.
        PosepplError: The disk is full.
    """
    document = ElementTree.Element("OpenSimDocument", Version=VERSION)
    model = ElementTree.SubElement(document, "Model", name=name)
    ElementTree.SubElement(model, "Ground", name="ground")
    _text(model, "gravity", "0 -9.80665 0")
    bodies = _objects(model, "BodySet", "bodyset")
    for each in segments:
        body = ElementTree.SubElement(bodies, "Body", name=each.name)
        _text(body, "mass", f"{max(each.mass, 1e-3) * mass:.6g}")
        _text(body, "mass_center", "0 0 0")
        _text(body, "inertia", "0.1 0.1 0.1 0 0 0")
    joints = _objects(model, "JointSet", "jointset")
    for each in segments:
        _joint(joints, each)
    marks = _objects(model, "MarkerSet", "markerset")
    for mark in markers:
        element = ElementTree.SubElement(marks, "Marker", name=mark.name)
        _text(element, "socket_parent_frame", f"/bodyset/{mark.segment}")
        _text(element, "location", _numbers(mark.place))
        _text(element, "fixed", "true")
    ElementTree.indent(document)
    write_atomically(path, ElementTree.tostring(document, encoding="unicode", xml_declaration=True) + "\n")


def _joint(joints: ElementTree.Element, each: OsimSegment) -> None:
    """A CustomJoint from the parent's place to the body's origin."""
    joint = ElementTree.SubElement(joints, "CustomJoint", name=f"{each.name}_joint")
    _text(joint, "socket_parent_frame", f"{each.parent}_offset")
    _text(joint, "socket_child_frame", f"{each.name}_offset")
    coordinates = ElementTree.SubElement(joint, "coordinates")
    for name in (*each.turns, *each.moves):
        coordinate = ElementTree.SubElement(coordinates, "Coordinate", name=name)
        _text(coordinate, "range", "-10 10" if name in each.moves else "-6.2832 6.2832")
    frames = ElementTree.SubElement(joint, "frames")
    for owner, place in ((each.parent, each.place), (each.name, (0.0, 0.0, 0.0))):
        frame = ElementTree.SubElement(frames, "PhysicalOffsetFrame", name=f"{owner}_offset")
        _text(frame, "socket_parent", "/ground" if owner == "ground" else f"/bodyset/{owner}")
        _text(frame, "translation", _numbers(place))
        _text(frame, "orientation", "0 0 0")
    motion = ElementTree.SubElement(joint, "SpatialTransform")
    for number, (coordinate_name, sign) in enumerate(_motions(each)):
        kind = ("rotation", "translation")[number // 3]
        axis = ElementTree.SubElement(motion, "TransformAxis", name=f"{kind}{number % 3 + 1}")
        _text(axis, "coordinates", coordinate_name or "")
        _text(axis, "axis", _AXES[number])
        if coordinate_name:
            _text(ElementTree.SubElement(axis, "LinearFunction", name="function"), "coefficients", f"{sign} 0")
        else:
            _text(ElementTree.SubElement(axis, "Constant", name="function"), "value", "0")


def _motions(each: OsimSegment) -> Iterator[tuple[str | None, int]]:
    """Coordinates of the six motions, None where there is none, and their signs."""
    for number in range(3):
        yield (each.turns[number], each.signs[number]) if number < len(each.turns) else (None, 1)
    for number in range(3):
        yield (each.moves[number] if each.moves else None), 1


def _objects(parent: ElementTree.Element, kind: str, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(ElementTree.SubElement(parent, kind, name=name), "objects")


def _text(parent: ElementTree.Element, tag: str, text: str) -> None:
    ElementTree.SubElement(parent, tag).text = text


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
