"""The body of Sminchisescu and Triggs (2001, section 2): superquadrics on a skeleton of 8, 30 or 34 coordinates.

doi:10.1109/CVPR.2001.990509. The paper names the numbers of coordinates, the clavicles (the four that 34 has more than 30),
tapered and bent superquadrics with nine parameters a part, and internal proportions of hips, clavicles and skull tip. Which
joints turn about which axes it leaves to a drawing. Chosen here: 6 for the pelvis; 3 each for thorax, neck, shoulders and hips;
1 each for elbows, knees and ankles; clavicles go up and forward. The arm's 8 are the shoulder's position and rotation, the
elbow and the forearm's twist; it hangs on a trunk that stands upright, facing anywhere, so that its first turn, about the
vertical, has no limit. Axes and signs are those of :mod:`poseppl_models.bodies.cone_body`. Sixteen parts, three of
the arm: their shapes are ours.

All offsets, centres and half-axes are linear in the sizes of :mod:`poseppl_models.bodies.anthropometry`, so that tree and
flesh of other sizes are arrays of the same programs (:meth:`SuperquadricBody.sized_in`), with gradients.

>>> [superquadric_body(kind).tree.dimension for kind in AXES]
[8, 30, 34]

For the parts the paper (section 2) has superquadric ellipsoids with tapering and bending and gives no numbers: exponents,
tapers, bends and how far parts reach beyond their joints are chosen here to look like an adult in thin clothes. Centres and
half-axes are linear in the sizes (mm).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.geometry import Joint, KinematicTree, Marker, kinematic_tree
from poseppl_models.bodies.anthropometry import humanoid_sizes
from poseppl_models.bodies.cone_body import REST
from poseppl_models.bodies.joint_angles import joint_limits
from poseppl_models.bodies.joint_names import mirrored_angle
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, Superquadrics, superquadrics_of

Kind = Literal["arm", "stiff_shoulders", "full"]
_BODY = {
    "pelvis": "ZYX",
    "thorax": "ZYX",
    "neck": "ZYX",
    "shoulder": "ZYX",
    "elbow": "X",
    "hip": "ZYX",
    "knee": "X",
    "ankle": "X",
}
AXES: Mapping[Kind, Mapping[str, str]] = {
    "arm": {"shoulder": "ZYX", "elbow": "XZ"},
    "stiff_shoulders": _BODY,
    "full": {**_BODY, "clavicle": "ZY"},
}
"""Axes of each joint, sides left out."""
STABILISERS: Mapping[str, float] = {"clavicle": 0.15, "thorax": 0.6, "neck": 0.5, "ankle": 0.4}
"""Standard deviations (radians) of joints about their equilibrium, all angles 0; ours."""
_REST = {**REST, ("ankle", "X"): 0.1}


class SuperquadricBody(NamedTuple):
    """A body of superquadrics.

    Attributes:
        tree: The kinematic tree.
        flesh: The parts.
        limits: Least and largest value of each coordinate (d, 2), radians; infinite where nothing limits it.
        stabilisers: Standard deviation of each coordinate about 0 (d,), infinite where it has no stabiliser.
        rest: State of a person at rest at the origin (d,).
        sizes: Lengths and half-widths, mm.
        kind: Which body.
    """

    tree: KinematicTree
    flesh: Superquadrics
    limits: Floats
    stabilisers: Floats
    rest: Floats
    sizes: Mapping[str, float]
    kind: Kind

    def sized_in(self, tree: KinematicTree, flesh: Superquadrics, sizes: Array) -> tuple[KinematicTree, Superquadrics]:
        """A given tree and flesh with sizes (S,) or (S, N), mm, in the order of the body's; batch last where there is one."""
        arrays = (jnp.tensordot(part, sizes, ((0,), (0,)), precision="highest") for part in _basis(self.kind))
        offsets, markers, centres, half_axes = arrays
        return tree.with_offsets(offsets, markers), replace(flesh, centres=centres, half_axes=half_axes)


def superquadric_body(kind: Kind = "full", sizes: Mapping[str, float] | None = None) -> SuperquadricBody:
    """Build a body.

    Args:
        kind: "arm" (8 coordinates), "stiff_shoulders" (30) or "full" (34).
        sizes: Lengths and half-widths (mm) that differ from the standard humanoid's.

    Raises:
        ValueError: An unknown size.
    """
    standard = humanoid_sizes()
    unknown = set(sizes or {}) - set(standard)
    if unknown:
        raise ValueError(f"no size {sorted(unknown)[0]!r}; expected names of {sorted(standard)}")
    own = {**standard, **(sizes or {})}
    joints, markers, parts = _laid_out(kind, own)
    tree = kinematic_tree(joints, markers).with_pattern_of(_pattern(kind))
    stabilisers = np.array([STABILISERS.get(joint.partition("_")[0], np.inf) for joint, _ in tree.coordinates])
    flesh = superquadrics_of(tree, parts, pieces=1)
    limits = joint_limits(tree)
    if kind == "arm":
        limits[tree.coordinates.index(("shoulder_r", "Z"))] = -np.inf, np.inf
    return SuperquadricBody(tree, flesh, limits, stabilisers, _rest(tree, own), own, kind)


def _laid_out(kind: Kind, size: Mapping[str, float]) -> tuple[list[Joint], list[Marker], list[Any]]:
    """Joints, markers and parts."""
    return (_arm if kind == "arm" else _body)(size, AXES[kind])


@lru_cache(maxsize=8)
def _pattern(kind: Kind) -> KinematicTree:
    """A tree none of whose offsets is 0 that depends on a size."""
    joints, markers, _ = _laid_out(kind, dict.fromkeys(humanoid_sizes(), 1.0))
    return kinematic_tree(joints, markers)


@lru_cache(maxsize=8)
def _basis(kind: Kind) -> tuple[Floats, ...]:
    """The effect of a mm of each size (sizes, ...) on the tree's offsets, the markers', the parts' centres and half-axes."""
    names = tuple(humanoid_sizes())
    rows = []
    for name in names:
        one = dict.fromkeys(names, 0.0) | {name: 1.0}
        joints, markers, parts = _laid_out(kind, one)
        with jax.ensure_compile_time_eval():  # also where it is first called by a program that is traced
            tree = kinematic_tree(joints, markers)
        shapes = (np.array([getattr(part, field) for part in parts]) for field in ("centre", "half_axes"))
        rows.append((np.asarray(tree.offsets), np.asarray(tree.marker_offsets), *shapes))
    return tuple(np.stack(column) for column in zip(*rows, strict=True))


def _arm(size: Mapping[str, float], axes: Mapping[str, str]) -> tuple[list[Joint], list[Marker], list[Any]]:
    """The right arm."""
    joints = [
        Joint("shoulder_r", None, (0, 0, 0), axes["shoulder"]),
        Joint("elbow_r", "shoulder_r", (0, 0, -size["upper_arm"]), axes["elbow"]),
    ]
    markers = [
        Marker("shoulder_r", "shoulder_r"),
        Marker("elbow_r", "elbow_r"),
        Marker("wrist_r", "elbow_r", (0, 0, -size["forearm"])),
        Marker("thumb_r", "elbow_r", (0, 0.5 * size["hand"], -size["forearm"] - 0.3 * size["hand"])),
    ]
    return joints, markers, arm_parts(size, "r", "elbow_r")


def _body(size: Mapping[str, float], axes: Mapping[str, str]) -> tuple[list[Joint], list[Marker], list[Any]]:
    joints = [
        Joint("pelvis", None, (0, 0, 0), axes["pelvis"]),
        Joint("thorax", "pelvis", (0, 0, size["waist"]), axes["thorax"]),
        Joint("neck", "thorax", (0, 0, size["thorax"]), axes["neck"]),
    ]
    markers = [
        Marker("pelvis", "pelvis"),
        Marker("chest", "thorax", (0, 0, 0.33 * size["thorax"])),
        Marker("neck", "neck"),
        Marker("skull", "neck", (0.0, size["skull_forward"], size["neck"])),
        Marker("crown", "neck", (0.0, size["skull_forward"], size["neck"] + size["head"])),
    ]
    for side, sign in (("l", -1.0), ("r", 1.0)):
        joints += [Joint(f"{name}_{side}", *row) for name, row in _limb_joints(size, axes, side, sign).items()]
        markers += [Marker(f"{name}_{side}", f"{name}_{side}") for name in ("shoulder", "elbow", "hip", "knee", "ankle")]
        markers += [
            Marker(f"wrist_{side}", f"elbow_{side}", (0, 0, -size["forearm"])),
            Marker(f"toe_{side}", f"ankle_{side}", (0, 0.75 * size["foot"], -size["ankle_height"])),
        ]
    return joints, markers, body_parts(size)


def _limb_joints(size: Mapping[str, float], axes: Mapping[str, str], side: str, sign: float) -> dict[str, Any]:
    """Parent, offset and axes of the joints of one side."""
    clavicle = (sign * size["clavicle_side"], size["clavicle_forward"], size["thorax"] + size["clavicle_up"])
    return {
        "clavicle": ("thorax", clavicle, axes.get("clavicle", "")),
        "shoulder": (f"clavicle_{side}", (sign * size["shoulder_side"], 0, -size["shoulder_drop"]), axes["shoulder"]),
        "elbow": (f"shoulder_{side}", (0, 0, -size["upper_arm"]), axes["elbow"]),
        "hip": ("pelvis", (sign * size["hip_side"], size["hip_forward"], -size["hip_drop"]), axes["hip"]),
        "knee": (f"hip_{side}", (0, 0, -size["thigh"]), axes["knee"]),
        "ankle": (f"knee_{side}", (0, 0, -size["shank"]), axes["ankle"]),
    }


def _rest(tree: KinematicTree, size: Mapping[str, float]) -> Floats:
    """At rest, a little bent, which distinguishes front from back."""
    rest = np.array([mirrored_angle(_REST, joint, axis) for joint, axis in tree.coordinates])
    legs = (size["thigh"] + size["shank"]) * np.cos(0.1) + size["ankle_height"] + size["hip_drop"]
    rest[2] = legs if "pelvis" in tree.joint_names else legs + size["waist"] + size["thorax"]
    return rest


Sizes = Mapping[str, float]
_FORWARD = 1.5708
"""Direction in which limbs bow, radians from their own x: their y points backwards, for their z points down."""


def arm_parts(size: Sizes, side: str, hand_joint: str) -> list[Superquadric]:
    """Upper arm, forearm and hand."""
    return [
        _limb(f"upper_arm_{side}", f"shoulder_{side}", size["upper_arm"], size["upper_arm_width"], -0.1),
        _limb(f"forearm_{side}", f"elbow_{side}", size["forearm"], size["forearm_width"], -0.22),
        Superquadric(
            f"hand_{side}",
            hand_joint,
            (0.65 * size["hand_width"], 1.25 * size["hand_width"], 0.5 * size["hand"]),
            (0.8, 0.8),
            centre=(0.0, 0.0, -size["forearm"] - 0.42 * size["hand"]),
            axis=(0.0, 0.0, -1.0),
        ),
    ]


def body_parts(size: Sizes) -> list[Superquadric]:
    """All sixteen."""
    parts = _trunk(size)
    for side in "lr":
        parts += arm_parts(size, side, f"elbow_{side}")
        parts += [
            _limb(f"thigh_{side}", f"hip_{side}", size["thigh"], 1.08 * size["thigh_width"], -0.18, bend=0.1),
            _limb(f"shank_{side}", f"knee_{side}", size["shank"], 1.08 * size["shank_width"], -0.25, bend=0.1),
            Superquadric(
                f"foot_{side}",
                f"ankle_{side}",
                (1.1 * size["foot_width"], 0.5 * size["ankle_height"] + 0.4 * size["foot_width"], 0.52 * size["foot"]),
                (0.7, 0.8),
                centre=(0.0, 0.27 * size["foot"], -0.45 * size["ankle_height"]),
                axis=(0.0, 1.0, 0.0),
            ),
        ]
    return parts


def _trunk(size: Sizes) -> list[Superquadric]:
    """Pelvis, chest, neck and head."""
    return [
        Superquadric(
            "pelvis",
            "pelvis",
            (size["pelvis_width"], 0.9 * size["chest_depth"], 0.75 * size["waist"] + 0.4 * size["pelvis_width"]),
            (0.6, 0.8),
            centre=(0.0, 0.0, 0.35 * size["waist"]),
        ),
        Superquadric(
            "chest",
            "thorax",
            (size["chest_width"], size["chest_depth"], 0.52 * size["thorax"]),
            (0.5, 0.8),
            taper=(0.08, 0.02),
            centre=(0.0, 0.0, 0.48 * size["thorax"]),
        ),
        Superquadric(
            "neck",
            "neck",
            (0.8 * size["head_width"], 0.8 * size["head_width"], 0.6 * size["neck"]),
            (0.5, 1.0),
            centre=(0.0, 0.0, 0.4 * size["neck"]),
        ),
        Superquadric(
            "head",
            "neck",
            (size["head_width"], 1.25 * size["head_width"], 0.45 * size["head"] + 0.25 * size["neck"]),
            (0.85, 1.0),
            taper=(0.1, 0.05),
            centre=(0.0, size["skull_forward"], 0.73 * size["neck"] + 0.55 * size["head"]),
        ),
    ]


def _limb(name: str, joint: str, length: float, width: float, taper: float, bend: float = 0.0) -> Superquadric:
    """A part down its joint's z that reaches a little beyond both ends."""
    return Superquadric(
        name,
        joint,
        (width, width, 0.5 * length + 0.5 * width),
        (0.6, 1.0),
        taper=(taper, taper),
        bend=bend,
        bend_towards=_FORWARD,
        centre=(0.0, 0.0, -0.5 * length),
        axis=(0.0, 0.0, -1.0),
    )
