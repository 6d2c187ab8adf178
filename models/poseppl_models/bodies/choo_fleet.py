"""The articulated body of Choo and Fleet 2001, sections 7.1 and 7.2, as NumPyro programs.

28 coordinates: 6 for the spine's position and orientation, 3 for the head, each hip and each shoulder, 2 for the pelvis, 1
for the hinge between spine and shoulders, 1 for each elbow and knee. 17 markers at the joints. The state moves by a Gaussian
random walk, and the markers are seen in every camera with Gaussian noise (Eqs. 18-20).

The paper draws the tree and the markers (Fig. 1) and leaves details to the drawing. Chosen here: the spine's frame sits at its
lower end, z up, y forward, x to the right; the pelvis turns about Z and Y (a turn about its X axis would not move the hips),
the shoulder hinge about Z; elbows and knees about X; a part's z axis runs along its limb. The markers are both ends and the
middle of the spine, both ends of the head, shoulders, elbows, wrists, hips, knees and ankles.

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names), len(arm().free_coordinates), len(lower_body().free_coordinates)
(28, 17, 4, 10)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Joint, KinematicTree, Marker, kinematic_tree
from poseppl_models.bodies.joint_angles import POSTURES
from poseppl_models.bodies.joint_names import ALIASES, edges_along, segments
from poseppl_models.bodies.random_walk import mean_reverting_walk, see_points, walking_body

NOISE = 0.003
"""Standard deviation of the image noise at focal length 1 (section 7.3)."""
RATE = 30.0
"""Frames a second of the paper's recordings."""
SIGMA_POSITION = 15.0 * RATE**0.5
"""Standard deviation of the random walk of translations, mm per square root of a second: 15 mm a frame of the paper."""
SIGMA_ANGLE = 0.15 * RATE**0.5
"""Standard deviation of the random walk of angles, radians per square root of a second: 0.15 a frame of the paper."""
WALK: Mapping[str, float] = {"sigma_position": SIGMA_POSITION, "sigma_angle": SIGMA_ANGLE}
"""Both, as the params of a body that is seen as points."""
REST_ANGLE = 0.1
"""Flexion of the hips at rest (radians); knees and elbows are bent twice as far."""

LENGTHS: Mapping[str, float] = {
    "spine": 480.0,
    "chest": 240.0,
    "neck": 90.0,
    "head": 170.0,
    "shoulder_width": 180.0,
    "shoulder_forward": 0.0,
    "shoulder_drop": 20.0,
    "upper_arm": 290.0,
    "forearm": 255.0,
    "hip_width": 90.0,
    "hip_forward": 0.0,
    "hip_drop": 60.0,
    "thigh": 420.0,
    "shank": 410.0,
}
"""Segment lengths (mm) of a subject of 1.75 m.

Widths are from the midline; ``chest`` is the middle marker's height. Drops and forwards, which may be negative, place the
middle between both shoulders against the neck and the middle between both hips against the pelvis: skeletons that were solved
from optical markers put the shoulders 30 to 60 mm above the end of the spine, and the hips 45 to 75 mm in front of its root.
"""

LIMBS = (("neck", "shoulder", "elbow", "wrist"), ("pelvis", "hip", "knee", "ankle"))
EDGES = edges_along(("pelvis", "chest", "neck", "skull", "crown"), LIMBS)


def choo_fleet_tree(lengths: Mapping[str, float] = LENGTHS) -> KinematicTree:
    """Lay out the tree of Fig. 1 for segment lengths in mm; all subjects have the same pattern of offsets."""
    return _tree({**LENGTHS, **lengths}).with_pattern_of(_tree(dict.fromkeys(LENGTHS, 1.0)))


def _tree(size: Mapping[str, float]) -> KinematicTree:
    return kinematic_tree(*joints_and_markers(size))


def joints_and_markers(size: Mapping[str, float]) -> tuple[list[Joint], list[Marker]]:
    """The joints and markers of Fig. 1 for segment lengths in mm, parents first."""
    joints = [
        Joint("spine", None, (0, 0, 0), "ZYX"),
        Joint("head", "spine", (0, 0, size["spine"]), "ZYX"),
        Joint("pelvis", "spine", (0, 0, 0), "ZY"),
        Joint("girdle", "spine", (0, 0, size["spine"]), "Z"),
    ]
    markers = [
        Marker("pelvis", "spine"),
        Marker("chest", "spine", (0, 0, size["chest"])),
        Marker("neck", "spine", (0, 0, size["spine"])),
        Marker("skull", "head", (0, 0, size["neck"])),
        Marker("crown", "head", (0, 0, size["neck"] + size["head"])),
    ]
    for side, sign in (("l", -1.0), ("r", 1.0)):
        shoulder = (sign * size["shoulder_width"], size["shoulder_forward"], -size["shoulder_drop"])
        hip = (sign * size["hip_width"], size["hip_forward"], -size["hip_drop"])
        joints += [
            Joint(f"shoulder_{side}", "girdle", shoulder, "ZYX"),
            Joint(f"elbow_{side}", f"shoulder_{side}", (0, 0, -size["upper_arm"]), "X"),
            Joint(f"hip_{side}", "pelvis", hip, "ZYX"),
            Joint(f"knee_{side}", f"hip_{side}", (0, 0, -size["thigh"]), "X"),
        ]
        markers += [
            Marker(f"shoulder_{side}", f"shoulder_{side}"),
            Marker(f"elbow_{side}", f"elbow_{side}"),
            Marker(f"wrist_{side}", f"elbow_{side}", (0, 0, -size["forearm"])),
            Marker(f"hip_{side}", f"hip_{side}"),
            Marker(f"knee_{side}", f"knee_{side}"),
            Marker(f"ankle_{side}", f"knee_{side}", (0, 0, -size["shank"])),
        ]
    return joints, markers


def full_body(lengths: Mapping[str, float] | None = None, *, free: tuple[str, ...] | None = None) -> Body:
    """Build the 28-DOF body.

    Args:
        lengths: Segment lengths in mm that differ from :data:`LENGTHS`.
        free: Joints that are tracked; the others are clamped. All by default.
    """
    sizes = {**LENGTHS, **(lengths or {})}
    tree = choo_fleet_tree(sizes)
    program, rest = walking_body(tree.coordinates, see_points, mean_reverting_walk), standing_pose(tree, sizes)
    body = Body(program, tree, EDGES, "pelvis", ALIASES, sizes, measure, free, rest, WALK, NOISE)
    return body._replace(segments=segments("spine"), postures=POSTURES)


def standing_pose(tree: KinematicTree, size: Mapping[str, float]) -> np.ndarray:
    """State (d,) of standing at ease: knees and elbows slightly bent, which distinguishes front from back; soles are level."""
    rest = np.zeros(tree.dimension)
    rest[2] = (size["shank"] + size["thigh"]) * np.cos(REST_ANGLE) + size["hip_drop"]
    bends = {"hip": REST_ANGLE, "knee": -2 * REST_ANGLE, "ankle": REST_ANGLE, "elbow": 2 * REST_ANGLE}
    for index, (joint, axis) in enumerate(tree.coordinates):
        if axis == "X":
            rest[index] = bends.get(joint.partition("_")[0], 0.0)
    return rest


def lower_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the 10-DOF tracker: pelvis, hips and knees; the rest is clamped."""
    return full_body(lengths, free=("pelvis", "hip_l", "hip_r", "knee_l", "knee_r"))


def arm(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the 4-DOF tracker: the right shoulder and elbow; the rest is clamped."""
    return full_body(lengths, free=("shoulder_r", "elbow_r"))


def measure(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure a subject's segment lengths (mm) as medians over frames, left and right averaged.

    Args:
        markers: Positions (T, 3) in mm by marker name, NaN where unseen. Lengths that need a marker that is never seen are
            those of :data:`LENGTHS` in proportion to the measured ones.

    Raises:
        ValueError: Pelvis or hips are missing, or neither the neck and the shoulders nor the knees are there: without them a
            body has no scale.
    """
    seen = {name: np.asarray(place, float) for name, place in markers.items() if np.isfinite(place).all(-1).any()}
    missing = {"pelvis", "hip_l", "hip_r"} - set(seen)
    trunk = {"neck", "shoulder_l", "shoulder_r"} - set(seen)
    if missing or (trunk and not {"knee_l", "knee_r"} & set(seen)):
        raise ValueError(f"no {', '.join(sorted(missing | trunk))} among the markers")
    lengths: dict[str, float] = {}
    for name, pairs in _SEGMENTS.items():
        found = [median_of(np.linalg.norm(seen[a] - seen[b], axis=-1)) for a, b in pairs if a in seen and b in seen]
        if found:
            lengths[name] = float(np.mean(found))
    up = unit_vector(seen["neck"] - seen["pelvis"]) if "neck" in seen else np.array([0.0, 0.0, 1.0])
    lengths |= _flare(seen, up, "hip", "pelvis")
    if not trunk:
        lengths |= _flare(seen, up, "shoulder", "neck")
    if "chest" in seen and "neck" in seen:
        lengths["chest"] = median_of(np.sum((seen["chest"] - seen["pelvis"]) * up, -1))
    if {"neck", "skull", "crown"} <= set(seen):  # the nearest points on the line that the body has
        whole = seen["crown"] - seen["neck"]
        lengths["neck"] = median_of(np.sum((seen["skull"] - seen["neck"]) * unit_vector(whole), -1))
        lengths["head"] = median_of(np.linalg.norm(whole, axis=-1)) - lengths["neck"]
    return _in_proportion(lengths) | lengths


_SEGMENTS = {
    "spine": (("pelvis", "neck"),),
    "neck": (("neck", "skull"),),
    **{
        name: tuple((f"{upper}_{side}", f"{lower}_{side}") for side in "lr")
        for name, upper, lower in (
            ("upper_arm", "shoulder", "elbow"),
            ("forearm", "elbow", "wrist"),
            ("thigh", "hip", "knee"),
            ("shank", "knee", "ankle"),
        )
    },
}


def _in_proportion(measured: Mapping[str, float]) -> dict[str, float]:
    """The standard lengths at the size that the measured limbs have."""
    limbs = [name for name in _SEGMENTS if name in measured]
    size = sum(measured[name] for name in limbs) / sum(LENGTHS[name] for name in limbs)
    return {name: size * length for name, length in LENGTHS.items()}


def _flare(markers: Mapping[str, Any], up: np.ndarray, ends: str, centre: str) -> dict[str, float]:
    """Place two joints against the spine: half their width, how far their middle lies in front of ``centre`` and below."""
    left, right = markers[f"{ends}_l"], markers[f"{ends}_r"]
    across = right - left
    forward = np.cross(up, unit_vector(across))  # the tilt across the spine only shortens it by a cosine
    middle = (left + right) / 2 - markers[centre]
    return {
        f"{ends}_width": median_of(np.linalg.norm(across, axis=-1)) / 2,
        f"{ends}_forward": median_of(np.sum(middle * unit_vector(forward), -1)),
        f"{ends}_drop": -median_of(np.sum(middle * up, -1)),
    }


def unit_vector(vector: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) of length 1 in the same directions."""
    unit: np.ndarray = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    return unit


def median_of(values: np.ndarray) -> float:
    """The median of the values that are known; NaN of none."""
    known = np.sort(values[~np.isnan(values)])
    return float((known[(known.size - 1) // 2] + known[known.size // 2]) / 2) if known.size else float("nan")
