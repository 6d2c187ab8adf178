"""Bodies of cones on one skeleton: what the published bodies of image-based trackers share.

The skeleton's joints are a pelvis (the root, between the hips), a thorax at the same position, shoulders, elbows, wrists, hips,
knees and ankles. A neck and two clavicles lie where the shoulders' line crosses the midline. A body declares the rotation axes
of each joint, "" for none, and the cones that it moves. z points up, y forward, x to the right; limbs hang along -z. Elbows
bend by positive rotations about X, and knees by negative ones. Left limbs are lifted sideways by positive rotations about Y,
right limbs by negative ones. Parts have the name of their segment, with ``_l`` or ``_r``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.geometry import Joint, KinematicTree, Marker, kinematic_tree
from poseppl.motion.geometry.flesh import Cone, Flesh, flesh_of
from poseppl_models.bodies.anthropometry import TORSO_DEPTH, segment_lengths, segment_radii
from poseppl_models.bodies.joint_limits import joint_limits
from poseppl_models.bodies.sides import mirrored_angle, neighbours_in

Pairs = tuple[tuple[int, int], ...]
_CHAINS = (("torso", "upper_arm", "forearm", "hand"), ("torso", "thigh", "shank", "foot"), ("torso", "head"))
REST = {("knee", "X"): -0.2, ("hip", "X"): 0.1, ("elbow", "X"): 0.2, ("shoulder", "Y"): 0.2}
"""Angles (radians) of the left side of a person at rest; a little bent, which distinguishes front from back."""


class ConeBody(NamedTuple):
    """A body of cones.

    Attributes:
        tree: The kinematic tree; its markers are the joints, and the ends of head, hands and feet.
        flesh: The cones.
        limits: Least and largest value of each coordinate (d, 2), radians; infinite where nothing limits it.
        apart: Pairs of parts that cannot meet: all but those that meet at a joint.
        rest: State of a person at rest at the origin (d,).
    """

    tree: KinematicTree
    flesh: Flesh
    limits: Floats
    apart: Pairs
    rest: Floats


def cone_body(lengths: Mapping[str, float], axes: Mapping[str, str], cones: Sequence[Cone]) -> ConeBody:
    """Put cones on the skeleton.

    Args:
        lengths: Segment lengths as by :func:`poseppl_models.bodies.anthropometry.segment_lengths`, mm.
        axes: Axes of each joint, sides left out; those that are missing do not turn.
        cones: The parts.
    """
    tree = kinematic_tree(_joints(lengths, axes), _markers(lengths))
    rest = np.array([mirrored_angle(REST, joint, axis) for joint, axis in tree.coordinates])
    rest[2] = lengths["thigh"] * np.cos(0.1) + lengths["shank"] * np.cos(0.1) + lengths["ankle_height"]
    return ConeBody(tree, flesh_of(tree, cones), joint_limits(tree), _apart([cone.name for cone in cones]), rest)


def with_crown(body: ConeBody, height: float) -> ConeBody:
    """The body with its marker ``crown`` so high above the neck (mm): recordings put it inside of the head. Cones stay."""
    offsets = body.tree.marker_offsets.at[body.tree.marker_names.index("crown"), 2].set(height)
    return body._replace(tree=body.tree.with_offsets(body.tree.offsets, offsets))


def limb_cones(lengths: Mapping[str, float], radii: Mapping[str, tuple[float, float]], names: Sequence[str]) -> list[Cone]:
    """Cones of both sides for segments named as in :func:`poseppl_models.bodies.anthropometry.segment_radii`."""
    joints = {"upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shank": "knee", "foot": "ankle"}
    cones = []
    for name in names:
        for side in "lr":
            joint = f"{joints[name]}_{side}"
            if name == "foot":
                heel = (0.0, -0.25 * lengths["foot"], -0.5 * lengths["ankle_height"])
                cones.append(Cone(f"foot_{side}", joint, lengths["foot"], radii["foot"], origin=heel, axis=(0, 1, 0)))
            else:
                cones.append(Cone(f"{name}_{side}", joint, lengths[name], radii[name], axis=(0, 0, -1)))
    return cones


def trunk_cones(lengths: Mapping[str, float], radii: Mapping[str, tuple[float, float]]) -> list[Cone]:
    """The torso, from below the hips to the shoulders, and the head with the neck, which joins it."""
    below = 0.1 * lengths["trunk"]
    return [
        Cone("torso", "thorax", lengths["trunk"] + below, radii["torso"], (1.0, TORSO_DEPTH), origin=(0, 0, -below)),
        Cone("head", "neck", lengths["head"], radii["head"], (1.0, 1.2)),
    ]


def proportional_body(
    stature: float, known: Mapping[str, float] | None, axes: Mapping[str, str], limbs: Sequence[str]
) -> ConeBody:
    """Build the body of a person so tall (mm), its segments in proportion.

    Args:
        stature: The person's stature.
        known: Segment lengths (mm) that were measured.
        axes: Axes of each joint, as :func:`cone_body` takes them.
        limbs: Segments of the limbs that have a cone.
    """
    lengths, radii = segment_lengths(stature) | dict(known or {}), segment_radii(stature)
    return cone_body(lengths, axes, [*trunk_cones(lengths, radii), *limb_cones(lengths, radii, limbs)])


def _joints(size: Mapping[str, float], axes: Mapping[str, str]) -> list[Joint]:
    joints = [
        Joint("pelvis", None, (0, 0, 0), axes["pelvis"]),
        Joint("thorax", "pelvis", (0, 0, 0), axes.get("thorax", "")),
        Joint("neck", "thorax", (0, 0, size["trunk"]), axes.get("neck", "")),
    ]
    for side, sign in (("l", -1.0), ("r", 1.0)):
        rows = (
            ("clavicle", "thorax", (0.0, 0.0, size["trunk"])),
            ("shoulder", f"clavicle_{side}", (sign * size["shoulder_width"], 0.0, 0.0)),
            ("elbow", f"shoulder_{side}", (0.0, 0.0, -size["upper_arm"])),
            ("wrist", f"elbow_{side}", (0.0, 0.0, -size["forearm"])),
            ("hip", "pelvis", (sign * size["hip_width"], 0.0, 0.0)),
            ("knee", f"hip_{side}", (0.0, 0.0, -size["thigh"])),
            ("ankle", f"knee_{side}", (0.0, 0.0, -size["shank"])),
        )
        joints += [Joint(f"{name}_{side}", parent, offset, axes.get(name, "")) for name, parent, offset in rows]
    return joints


def _markers(size: Mapping[str, float]) -> list[Marker]:
    ends = {"hand": ("wrist", (0.0, 0.0, -size["hand"])), "toe": ("ankle", (0.0, 0.75 * size["foot"], -size["ankle_height"]))}
    limbs = [f"{name}_{side}" for side in "lr" for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")]
    return [
        *(Marker(joint, joint) for joint in ("pelvis", "neck", *limbs)),
        Marker("crown", "neck", (0, 0, size["head"])),
        *(Marker(f"{end}_{side}", f"{joint}_{side}", offset) for side in "lr" for end, (joint, offset) in ends.items()),
    ]


def _apart(names: Sequence[str]) -> Pairs:
    """Pairs of parts that do not follow each other in a limb of one side."""
    meet = neighbours_in(_CHAINS)
    pairs = ((i, j) for j in range(len(names)) for i in range(j))
    return tuple((i, j) for i, j in pairs if not meet(names[i], names[j]))
