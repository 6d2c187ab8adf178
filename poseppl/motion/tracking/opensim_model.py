"""A person's model for OpenSim: the segments of a result's body, with its lengths, coordinates and markers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.bodies.opensim import GROUND, PLACES, SEGMENT_AXES, Rotations, rotations_of
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.motion.io.opensim_files import OsimMarker, OsimSegment, write_osim

MASSES = {"pelvis": 0.142, "torso": 0.436, "femur": 0.1, "tibia": 0.0465, "calcn": 0.0145, "humerus": 0.028, "ulna": 0.022}
"""Shares of the body's mass, hand with ulna and head with torso (Winter 2009, doi:10.1002/9780470549148, Table 4.1, after
Dempster)."""


def write_model(path: FilePath, body: Body, name: str, markers: Sequence[str]) -> None:
    """Write the model of a body.

    Args:
        path: The .osim file, overwritten if it exists.
        body: The body, with the person's lengths.
        name: Name of the model.
        markers: Names of the body's markers that it has.

    Raises:
        InputError: The body says of no joint which segment of OpenSim it turns, or the file cannot be written.
        PosepplError: The disk is full.
    """
    if "pelvis" not in body.segments:
        expected = "one with segments of OpenSim, pelvis among them"
        raise InputError("the body has no pelvis of OpenSim", field=Argument("format", "osim"), expected=expected)
    write_osim(path, name, opensim_segments(body), opensim_markers(body, markers))


def opensim_segments(body: Body) -> list[OsimSegment]:
    """The segments of a body, parents first; joints that are of no segment of OpenSim are still, at 0."""
    at, joints = _places_at_zero(body.tree), body.segments
    found = []
    for each in _parents_first(body):
        joint = joints[each.below]
        above = None if each.above == GROUND else joints[each.above]
        place = np.zeros(3) if above is None else at[joint] - at[above]
        moves = tuple(PLACES) if above is None else ()
        mass = MASSES[each.below.removesuffix("_l").removesuffix("_r")]
        found.append(OsimSegment(each.below, each.above, _metres(place), each.names, each.signs, moves, mass))
    return found


def opensim_markers(body: Body, names: Sequence[str]) -> list[OsimMarker]:
    """Markers of these names on the segments of a body, without those of joints that OpenSim's bodies lack, as the head's."""
    tree = body.tree
    segment_of = {joint: segment for segment, joint in body.segments.items()}
    found = []
    for name, link, offset in zip(
        tree.marker_names, tree.marker_link, np.asarray(tree.marker_offsets, np.float64), strict=True
    ):
        joint = tree.joint_names[tree.link_joint[link]]
        if name in names and joint in segment_of:
            found.append(OsimMarker(name, segment_of[joint], _metres(offset)))
    return found


def _parents_first(body: Body) -> Iterator[Rotations]:
    """Rotations, each after that of the segment above it."""
    left, done = rotations_of(body), {GROUND}
    while ready := [each for each in left if each.above in done]:
        yield from ready
        done |= {each.below for each in ready}
        left = [each for each in left if each.below not in done]


def _places_at_zero(tree: KinematicTree) -> dict[str, Floats]:
    """Positions of the joints, mm, with all coordinates 0, when all frames are parallel."""
    places = np.zeros((len(tree.parents), 3))
    offsets = np.asarray(tree.offsets, np.float64)
    for link, parent in enumerate(tree.parents):
        places[link] = offsets[link] + (places[parent] if parent >= 0 else 0.0)
    return {joint: places[link] for joint, link in tree.last_links.items()}


def _metres(place: Floats) -> tuple[float, float, float]:
    """A place with x right, y forward, z up, mm, in OpenSim's axes, m."""
    forward, up, right = (place @ SEGMENT_AXES / 1000.0).tolist()
    return forward, up, right
