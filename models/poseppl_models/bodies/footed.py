"""The body of Choo and Fleet with feet and a face: for detectors that find heels and toes.

Each ankle turns about two axes: X, flexion, and Y, inversion; positive about X lifts the toes. A foot is rigid, with markers at
the heel and at the tips of the big and of the small toe. Its y axis goes forward from the heel to the middle between both tips,
and its z axis is normal to the sole: heel and toes lie ``foot_drop`` below the ankle, so that an ankle at 0 has the shank at a
right angle to the sole. No detector's points show the joint at the toes, which is left out.

Measured feet take the plane through heel and toes for the sole. Without the small toe it contains the shank's side, for then
nothing shows which way a foot at rest is inverted.

The head has markers at the nose, the eyes and the ears. Without a marker on the crown its z axis goes from the neck to the
middle between both ears.

>>> body = footed_body()
>>> body.tree.dimension, len(body.tree.marker_names)
(32, 28)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Joint, KinematicTree, Marker, kinematic_tree
from poseppl_models.bodies import choo_fleet
from poseppl_models.bodies.choo_fleet import joints_and_markers, median_of, standing_pose, unit_vector
from poseppl_models.bodies.joint_angles import FOOT_POSTURES, POSTURES
from poseppl_models.bodies.joint_names import ALIASES, FOOT_ALIASES, foot_segments, segments
from poseppl_models.bodies.random_walk import mean_reverting_walk, see_points, walking_body

FOOT_LENGTHS: Mapping[str, float] = {
    "foot_drop": 45.0,
    "foot_side": 0.0,
    "heel_back": 55.0,
    "big_toe_forward": 185.0,
    "small_toe_forward": 140.0,
    "toe_side": 35.0,
}
"""Offsets of each foot (mm), from the ankle: down and outward to the line of heel and toes, back to the heel, forward to the
tips of the toes, and half of the distance between both tips across. Heel to big toe is nine tenths of the length of a foot
(0.152 of a stature of 1.75 m; :mod:`poseppl_models.bodies.anthropometry`), because detectors place the heel and the tip inside
of it. The other offsets are our choice."""
FACE_LENGTHS: Mapping[str, float] = {
    "ear_up": 180.0,
    "ear_forward": 0.0,
    "ear_side": 75.0,
    "nose_up": 165.0,
    "nose_forward": 110.0,
    "eye_up": 205.0,
    "eye_forward": 85.0,
    "eye_side": 32.0,
}
"""Offsets of the head (mm), from the neck: up and forward; sideways from the midline. Our choice."""
LENGTHS: Mapping[str, float] = {**choo_fleet.LENGTHS, **FOOT_LENGTHS, **FACE_LENGTHS}
"""Segment lengths (mm) of a subject of 1.75 m."""

FOOT_MARKERS = tuple(f"{part}_{side}" for part in ("heel", "big_toe") for side in "lr")
"""Without these of a detector there is no foot to track."""


def footed_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body of 32 coordinates and 28 markers.

    Args:
        lengths: Segment lengths in mm that differ from :data:`LENGTHS`.
    """
    sizes = {**LENGTHS, **(lengths or {})}
    tree = _tree(sizes).with_pattern_of(_tree(dict.fromkeys(LENGTHS, 1.0)))
    program, rest = walking_body(tree.coordinates, see_points, mean_reverting_walk), standing_pose(tree, sizes)
    rest[2] += sizes["foot_drop"]
    edges = choo_fleet.EDGES + _edges()
    names = {**ALIASES, **FOOT_ALIASES}
    body = Body(program, tree, edges, "pelvis", names, sizes, measure, None, rest, choo_fleet.WALK, choo_fleet.NOISE)
    return body._replace(segments={**segments("spine"), **foot_segments()}, postures={**POSTURES, **FOOT_POSTURES})


def _edges() -> tuple[tuple[str, str], ...]:
    """Pairs of the markers of feet and face."""
    feet = (("ankle", "heel"), ("heel", "big_toe"), ("heel", "small_toe"), ("big_toe", "small_toe"))
    sided = tuple((f"{first}_{side}", f"{second}_{side}") for side in "lr" for first, second in (*feet, ("eye", "ear")))
    return (*sided, *(("nose", f"eye_{side}") for side in "lr"))


def _tree(size: Mapping[str, float]) -> KinematicTree:
    joints, markers = joints_and_markers(size)
    drop = -size["foot_drop"]
    inner, outer = size["foot_side"] - size["toe_side"], size["foot_side"] + size["toe_side"]
    markers.append(Marker("nose", "head", (0, size["nose_forward"], size["nose_up"])))
    for side, right in (("l", -1.0), ("r", 1.0)):
        ankle = f"ankle_{side}"
        joints.append(Joint(ankle, f"knee_{side}", (0, 0, -size["shank"]), "XY"))
        markers += [
            Marker(f"eye_{side}", "head", (right * size["eye_side"], size["eye_forward"], size["eye_up"])),
            Marker(f"ear_{side}", "head", (right * size["ear_side"], size["ear_forward"], size["ear_up"])),
            Marker(f"heel_{side}", ankle, (right * size["foot_side"], -size["heel_back"], drop)),
            Marker(f"big_toe_{side}", ankle, (right * inner, size["big_toe_forward"], drop)),
            Marker(f"small_toe_{side}", ankle, (right * outer, size["small_toe_forward"], drop)),
        ]
    return kinematic_tree(joints, markers)


def measure(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure a subject's segment lengths (mm) as medians over frames, left and right averaged.

    Args:
        markers: Positions (T, 3) in mm by marker name, NaN where unseen. Lengths that need a marker that is never seen are
            those of :data:`LENGTHS` in proportion; without the small toe, the big toe is straight ahead of the heel.

    Raises:
        ValueError: As :func:`poseppl_models.bodies.choo_fleet.measure`.
    """
    seen = {name: np.asarray(place, float) for name, place in markers.items() if np.isfinite(place).all(-1).any()}
    lengths = choo_fleet.measure(seen)
    size = sum(lengths[name] for name in ("thigh", "shank")) / sum(LENGTHS[name] for name in ("thigh", "shank"))
    usual = {name: size * length for name, length in {**FOOT_LENGTHS, **FACE_LENGTHS}.items()}
    feet = [found for side in "lr" if (found := _foot(seen, side))]
    names = {name for found in feet for name in found}
    measured = {name: float(np.mean([found[name] for found in feet if name in found])) for name in names}
    return {**usual, **lengths, **measured, **_face(seen)}


def _foot(seen: Mapping[str, Any], side: str) -> dict[str, float]:
    """Lengths of one foot; empty without its ankle, heel and big toe."""
    ankle, heel, big, small = (seen.get(f"{part}_{side}") for part in ("ankle", "heel", "big_toe", "small_toe"))
    if ankle is None or heel is None or big is None:
        return {}
    forward = unit_vector((big if small is None else (big + small) / 2) - heel)
    back = -_along(heel - ankle, forward)
    lengths = {"heel_back": median_of(back), "big_toe_forward": median_of(_along(big - ankle, forward))}
    below = heel - ankle + back[:, None] * forward
    if small is None:
        return {**lengths, "foot_drop": median_of(np.linalg.norm(below, axis=-1)), "foot_side": 0.0, "toe_side": 0.0}
    across = small - big - _along(small - big, forward)[:, None] * forward
    outward = unit_vector(across)
    down = np.cross(forward, outward) * (1.0 if side == "r" else -1.0)
    return {
        **lengths,
        "foot_drop": median_of(_along(below, down)),
        "foot_side": median_of(_along(below, outward)),
        "small_toe_forward": median_of(_along(small - ankle, forward)),
        "toe_side": median_of(np.linalg.norm(across, axis=-1)) / 2,
    }


def _face(seen: Mapping[str, Any]) -> dict[str, float]:
    """Lengths of the head; empty without the neck, both ears and the nose."""
    neck = seen.get("neck")
    if neck is None and {"shoulder_l", "shoulder_r"} <= set(seen):
        neck = (seen["shoulder_l"] + seen["shoulder_r"]) / 2
    if neck is None or not {"ear_l", "ear_r", "nose"} <= set(seen):
        return {}
    ears = (seen["ear_l"] + seen["ear_r"]) / 2
    up = unit_vector(seen.get("crown", ears) - neck)
    ahead = seen["nose"] - ears
    forward = unit_vector(ahead - _along(ahead, up)[:, None] * up)
    found = {"ear_side": median_of(np.linalg.norm(seen["ear_l"] - seen["ear_r"], axis=-1)) / 2}
    parts = {"ear": ears, "nose": seen["nose"]}
    if {"eye_l", "eye_r"} <= set(seen):
        parts["eye"] = (seen["eye_l"] + seen["eye_r"]) / 2
        found["eye_side"] = median_of(np.linalg.norm(seen["eye_l"] - seen["eye_r"], axis=-1)) / 2
    for part, place in parts.items():
        found |= {
            f"{part}_up": median_of(_along(place - neck, up)),
            f"{part}_forward": median_of(_along(place - neck, forward)),
        }
    return found


def _along(vectors: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Components (T,) of vectors (T, 3) along unit vectors (T, 3)."""
    components: np.ndarray = np.sum(vectors * directions, -1)
    return components
