"""Flesh of superquadrics for the 28-DOF body of :mod:`poseppl_models.choo_fleet`: 16 tapered and bent parts.

The shapes are those that Sminchisescu and Triggs (2001, section 2) flesh out their body with; the numbers are not theirs, whose
paper has none. Widths are those of the cones of :mod:`poseppl_models.choo_fleet_flesh` in the middle of each part.
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.motion.geometry.superquadrics import Superquadric
from poseppl_models.choo_fleet import LENGTHS
from poseppl_models.choo_fleet_flesh import TOES, FootSize

_BULGE = 1.08
"""How much thicker limbs are in their middle than cones: they go in at their ends."""


def superquadric_flesh(lengths: Mapping[str, float] = LENGTHS, *, girth: float = 1.0) -> list[Superquadric]:
    """Parts of a subject.

    Args:
        lengths: Segment lengths (mm) that differ from the standard subject's.
        girth: Factor of all widths.
    """
    size = {**LENGTHS, **lengths}
    parts = _trunk(size, girth)
    for side in "lr":
        arm, forearm, thigh, shank = (size[name] for name in ("upper_arm", "forearm", "thigh", "shank"))
        parts += [
            _limb(f"upper_arm_{side}", f"shoulder_{side}", arm, 0.19, 0.155, girth),
            _limb(f"forearm_{side}", f"elbow_{side}", 1.05 * forearm, 0.166, 0.128, girth),
            _hand(side, forearm, girth),
            _limb(f"thigh_{side}", f"hip_{side}", thigh, 0.205, 0.145, girth, bend=0.1),
            _limb(f"shank_{side}", f"knee_{side}", 1.06 * shank, 0.148, 0.115, girth, bend=0.15),
            _foot(side, shank, girth),
        ]
    return parts


def _trunk(size: Mapping[str, float], girth: float) -> list[Superquadric]:
    """Pelvis, chest, neck and head, all on the spine's side of the joints, y forward."""
    spine, shoulders = size["spine"], size["shoulder_width"]
    low, head = -0.12 * spine - 0.5 * size["hip_drop"], size["neck"] + size["head"]
    waist, top = 0.42 * spine, 1.02 * spine
    return [
        Superquadric(
            "pelvis",
            "spine",
            (girth * 0.78 * shoulders, girth * 0.52 * shoulders, 0.56 * (waist - low)),
            (0.6, 0.9),
            taper=(-0.02, -0.05),
            centre=(0.0, 0.0, 0.5 * (low + waist)),
        ),
        Superquadric(
            "chest",
            "spine",
            (girth * 0.84 * shoulders, girth * 0.55 * shoulders, 0.56 * (top - 0.8 * waist)),
            (0.5, 0.85),
            taper=(0.06, 0.02),
            bend=0.2,
            bend_towards=1.5708,
            centre=(0.0, 0.0, 0.5 * (top + 0.8 * waist)),
        ),
        Superquadric(
            "neck",
            "head",
            (girth * 0.36 * shoulders, girth * 0.4 * shoulders, 0.9 * size["neck"]),
            (0.4, 1.0),
            centre=(0.0, 0.0, 0.5 * size["neck"]),
        ),
        Superquadric(
            "head",
            "head",
            (girth * 0.42 * shoulders, girth * 0.52 * shoulders, 0.44 * head),
            (0.85, 1.0),
            taper=(0.12, 0.05),
            centre=(0.0, 0.0, 0.62 * head),
        ),
    ]


def _limb(name: str, joint: str, length: float, base: float, tip: float, girth: float, bend: float = 0.0) -> Superquadric:
    """A part down its joint's z whose radii at its ends are in proportion to its length, its middle bent forward."""
    middle = 0.5 * girth * (base + tip) * length * _BULGE
    taper = (tip - base) / (tip + base)
    return Superquadric(
        name,
        joint,
        (middle, middle, 0.54 * length),
        (0.6, 1.0),
        taper=(taper, taper),
        bend=bend,
        bend_towards=1.5708,  # its own y points backwards
        centre=(0.0, 0.0, -0.5 * length),
        axis=(0.0, 0.0, -1.0),
    )


def _hand(side: str, forearm: float, girth: float) -> Superquadric:
    """A flat part below the wrist."""
    return Superquadric(
        f"hand_{side}",
        f"elbow_{side}",
        (girth * 0.1 * forearm, girth * 0.17 * forearm, 0.26 * forearm),
        (0.8, 0.8),
        centre=(0.0, 0.0, -1.2 * forearm),
        axis=(0.0, 0.0, -1.0),
    )


def _foot(side: str, shank: float, girth: float) -> Superquadric:
    """A part forward from the heel."""
    size = FootSize.of_shank(shank)
    base, tip = size.radii
    middle, taper = 0.5 * girth * (base + tip) * _BULGE, (tip - base) / (tip + base)
    return Superquadric(
        f"foot_{side}",
        f"knee_{side}",
        (middle, middle, 0.54 * size.length),
        (0.6, 1.0),
        taper=(taper, taper),
        centre=(0.0, 0.25 * size.length, -shank - size.height + 0.5 * size.length * TOES[2]),
        axis=TOES,
    )
