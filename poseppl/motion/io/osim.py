"""OpenSim models (.osim): segments of a person's lengths, joints with coordinates, and markers; written, not read.

A model is a tree of rigid bodies. Each joint is a CustomJoint whose coordinates turn about Z, X and Y, as in OpenSim's
full-body models, and so it moves as a ``.mot`` says. There are no muscles, and masses are shares of the body's mass.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree

from poseppl.errors import FilePath
from poseppl.files.atomic_writing import write_atomically

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
