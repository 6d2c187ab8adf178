"""The articulated body of Choo and Fleet 2001, sections 7.1 and 7.2, as NumPyro programs.

28 coordinates: 6 for the spine's position and orientation, 3 for the head, each hip and each shoulder, 2 for the pelvis, 1 for the
hinge between spine and shoulders, 1 for each elbow and knee. 17 markers at the joints. The state moves by a Gaussian random walk,
and the markers are seen in every camera with Gaussian noise (Eqs. 18-20).

The paper draws the tree and the markers (Fig. 1) and leaves details to the drawing. Chosen here: the spine's frame sits at its
lower end, z up, y forward, x to the right; the pelvis turns about Z and Y (a turn about its X axis would not move the hips), the
shoulder hinge about Z; elbows and knees about X; a part's z axis runs along its limb. The markers are both ends and the middle of
the spine, both ends of the head, shoulders, elbows, wrists, hips, knees and ankles.

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names), len(arm().free_coordinates), len(lower_body().free_coordinates)
(28, 17, 4, 10)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl.body import Body, BodyInputs
from poseppl.distributions import ProjectedMarkers
from poseppl.geometry import Joint, KinematicTree, Marker, kinematic_tree, marker_positions
from poseppl.program import StateSpaceModel

NOISE = 0.003
"""Standard deviation of the image noise at focal length 1 (section 7.3)."""
SIGMA_POSITION = 15.0
"""Standard deviation of the random walk of translations, mm a frame."""
SIGMA_ANGLE = 0.15
"""Standard deviation of the random walk of angles, radians a frame."""

LENGTHS: Mapping[str, float] = {
    "spine": 480.0,
    "chest": 240.0,
    "neck": 90.0,
    "head": 170.0,
    "shoulder_width": 180.0,
    "shoulder_drop": 20.0,
    "upper_arm": 290.0,
    "forearm": 255.0,
    "hip_width": 90.0,
    "hip_drop": 60.0,
    "thigh": 420.0,
    "shank": 410.0,
}
"""Segment lengths (mm) of a subject of 1.75 m; widths are from the midline. ``chest`` is the middle marker's height."""

EDGES = (
    ("pelvis", "chest"),
    ("chest", "neck"),
    ("neck", "skull"),
    ("skull", "crown"),
    *((a.format(s), b.format(s)) for s in "lr" for a, b in (("neck", "shoulder_{}"), ("shoulder_{}", "elbow_{}"))),
    *((f"elbow_{s}", f"wrist_{s}") for s in "lr"),
    *((a.format(s), b.format(s)) for s in "lr" for a, b in (("pelvis", "hip_{}"), ("hip_{}", "knee_{}"))),
    *((f"knee_{s}", f"ankle_{s}") for s in "lr"),
)

_SIDES = {"l": ("l", "Left", "left"), "r": ("r", "Right", "right")}
ALIASES: Mapping[str, tuple[str, ...]] = {
    "pelvis": ("root", "Hips", "hip", "pelvis"),
    "chest": ("upperback", "Chest", "Spine1", "chest"),
    "neck": ("thorax", "Neck", "neck"),
    "skull": ("upperneck", "Head", "head"),
    "crown": ("head", "HeadEnd", "Head_end", "HeadTop", "crown"),
    **{
        f"{marker}_{side}": (f"{side}{bone}", f"{long}{part}", f"{marker}_{side}")
        for side, (_, long, _) in _SIDES.items()
        for marker, bone, part in (
            ("shoulder", "clavicle", "Arm"),
            ("elbow", "humerus", "ForeArm"),
            ("wrist", "radius", "Hand"),
            ("hip", "hipjoint", "UpLeg"),
            ("knee", "femur", "Leg"),
            ("ankle", "tibia", "Foot"),
        )
    },
}
"""Joint names of recordings for each marker: CMU's ASF bones (a bone's end), BVH joints, and our own names."""


def choo_fleet_tree(lengths: Mapping[str, float] = LENGTHS) -> KinematicTree:
    """Lay out the tree of Fig. 1 for segment lengths in mm."""
    size = {**LENGTHS, **lengths}
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
        shoulder = (sign * size["shoulder_width"], 0.0, -size["shoulder_drop"])
        hip = (sign * size["hip_width"], 0.0, -size["hip_drop"])
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
    return kinematic_tree(joints, markers)


def choo_fleet_programs(tree: KinematicTree) -> StateSpaceModel:
    """Write initial, transition and observation programs for any kinematic tree, one site for each joint."""
    sites: dict[str, list[int]] = {}
    for index, (joint, axis) in enumerate(tree.coordinates):
        sites.setdefault(f"{joint}_position" if axis in ("tx", "ty", "tz") else joint, []).append(index)
    spans = {name: slice(indices[0], indices[-1] + 1) for name, indices in sites.items()}

    def initial(params: Any, inputs: BodyInputs) -> None:
        for name, span in spans.items():
            numpyro.sample(name, dist.Normal(inputs.start[span], inputs.start_scale[span]))

    def transition(params: Any, state: Mapping[str, Any], inputs: BodyInputs) -> None:
        for name in spans:
            scale = params["sigma_position"] if name.endswith("_position") else params["sigma_angle"]
            numpyro.sample(name, dist.Normal(state[name], scale))

    def observation(params: Any, state: Mapping[str, Any], inputs: BodyInputs) -> None:
        pose = jnp.concatenate([state[name] for name in spans])
        numpyro.sample("points", ProjectedMarkers(tree, inputs.cameras, pose, inputs.noise))
        numpyro.deterministic("markers", marker_positions(tree, pose))

    return StateSpaceModel(initial, transition, observation)


def full_body(lengths: Mapping[str, float] | None = None, *, free: tuple[str, ...] | None = None) -> Body:
    """Build the 28-DOF body.

    Args:
        lengths: Segment lengths in mm that differ from :data:`LENGTHS`.
        free: Joints that are tracked; the others are clamped. All by default.
    """
    sizes = {**LENGTHS, **(lengths or {})}
    tree = choo_fleet_tree(sizes)
    rest = np.zeros(tree.dimension)
    rest[2] = sizes["shank"] + sizes["thigh"] + sizes["hip_drop"]
    params = {"sigma_position": SIGMA_POSITION, "sigma_angle": SIGMA_ANGLE}
    return Body(choo_fleet_programs(tree), tree, EDGES, "pelvis", ALIASES, sizes, measure, free, rest, params, NOISE)


def lower_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the 10-DOF tracker: pelvis, hips and knees; the rest is clamped."""
    return full_body(lengths, free=("pelvis", "hip_l", "hip_r", "knee_l", "knee_r"))


def arm(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the 4-DOF tracker: the right shoulder and elbow; the rest is clamped."""
    return full_body(lengths, free=("shoulder_r", "elbow_r"))


def measure(markers: Mapping[str, Any]) -> dict[str, float]:
    """Measure a subject's segment lengths (mm) as medians over frames, left and right averaged.

    Args:
        markers: Positions (T, 3) by marker name; all 17.
    """

    def median(a: Any, b: Any) -> float:
        return float(np.nanmedian(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=-1)))

    def limb(upper: str, lower: str) -> float:
        return (median(markers[f"{upper}_l"], markers[f"{lower}_l"]) + median(markers[f"{upper}_r"], markers[f"{lower}_r"])) / 2

    def flare(centre: str, ends: str) -> tuple[float, float]:
        """Half the width between two joints, and how far below (or above) the centre their middle lies."""
        width = median(markers[f"{ends}_l"], markers[f"{ends}_r"]) / 2
        middle = (np.asarray(markers[f"{ends}_l"]) + np.asarray(markers[f"{ends}_r"])) / 2
        return width, median(markers[centre], middle)

    shoulder_width, shoulder_drop = flare("neck", "shoulder")
    hip_width, hip_drop = flare("pelvis", "hip")
    return {
        "spine": median(markers["pelvis"], markers["neck"]),
        "chest": median(markers["pelvis"], markers["chest"]),
        "neck": median(markers["neck"], markers["skull"]),
        "head": median(markers["skull"], markers["crown"]),
        "shoulder_width": shoulder_width,
        "shoulder_drop": shoulder_drop,
        "upper_arm": limb("shoulder", "elbow"),
        "forearm": limb("elbow", "wrist"),
        "hip_width": hip_width,
        "hip_drop": hip_drop,
        "thigh": limb("hip", "knee"),
        "shank": limb("knee", "ankle"),
    }
