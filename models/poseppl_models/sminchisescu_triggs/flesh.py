"""Shapes of the parts of :mod:`poseppl_models.sminchisescu_triggs.body`: tapered and bent superquadrics.

The paper (section 2) has superquadric ellipsoids with tapering and bending and gives no numbers: exponents, tapers, bends and
how far parts reach beyond their joints are chosen here to look like an adult in thin clothes. Centres and half-axes are linear
in the sizes (mm).
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric

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
