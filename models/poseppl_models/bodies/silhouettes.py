"""The 28-DOF body seen as silhouettes: a likelihood for methods that use gradients, and the flesh that casts them.

The state and its random walk are those of :mod:`poseppl_models.bodies.choo_fleet`; a frame's data are
:class:`poseppl.motion.likelihoods.Silhouettes`, residuals in pixels whose value is 0. It is a likelihood and no heuristic:
its exponent is 1, and its noise was chosen by the coverage of intervals in rendered scenes.

Widths are chosen here to look like a clothed adult; no table stands behind them. Feet are those of
:mod:`poseppl_models.bodies.anthropometry` for the length of the shank.
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry.flesh import Cone, flesh_of
from poseppl_models.bodies.anthropometry import LENGTH_SHARES, segment_lengths, segment_radii
from poseppl_models.bodies.choo_fleet import LENGTHS, full_body as pointed_body
from poseppl_models.bodies.random_walk import mean_reverting_walk, see_silhouettes, walking_body


def full_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body, whose programs see silhouettes.

    Args:
        lengths: Segment lengths in mm that differ from the standard subject's.
    """
    body = pointed_body(lengths)
    flesh = flesh_of(body.tree, choo_fleet_flesh(body.lengths))
    program = walking_body(body.tree.coordinates, see_silhouettes, mean_reverting_walk)
    return body._replace(program=program, flesh=flesh)


def choo_fleet_flesh(lengths: Mapping[str, float] = LENGTHS) -> list[Cone]:
    """Cones of a subject.

    Args:
        lengths: Segment lengths (mm) that differ from the standard subject's.
    """
    size = {**LENGTHS, **lengths}
    spine, shoulders = size["spine"], size["shoulder_width"]
    torso = 1.35 * shoulders
    parts = [
        Cone(
            "torso",
            "spine",
            spine + 0.12 * spine + size["hip_drop"] * 0.5,
            (0.74 * shoulders, 0.86 * shoulders),
            (1.0, 0.66),
            origin=(0.0, 0.0, -0.12 * spine - size["hip_drop"] * 0.5),
        ),
        Cone(
            "head",
            "head",
            0.92 * (size["neck"] + size["head"]),
            (0.26 * torso, 0.36 * torso),
            (0.9, 1.1),
            origin=(0.0, 0.0, 0.12 * size["neck"]),
        ),
    ]
    for side in "lr":
        arm, forearm, thigh, shank = (size[name] for name in ("upper_arm", "forearm", "thigh", "shank"))
        parts += [
            _limb(f"upper_arm_{side}", f"shoulder_{side}", arm, 0.19, 0.155),
            _limb(f"forearm_{side}", f"elbow_{side}", 1.45 * forearm, 0.12, 0.11),
            _limb(f"thigh_{side}", f"hip_{side}", thigh, 0.205, 0.145),
            _limb(f"shank_{side}", f"knee_{side}", 1.06 * shank, 0.148, 0.115),
            _foot(side, shank),
        ]
    return parts


def _limb(name: str, joint: str, length: float, base: float, tip: float) -> Cone:
    """A cone down its joint's z, its radii in proportion to its length."""
    return Cone(name, joint, length, (base * length, tip * length), axis=(0.0, 0.0, -1.0))


TOES = (0.0, 1.0, 0.36)
"""Direction of a foot in the frame of its shank, y forward: 20 degrees up; recorded toes are 16 to 26 on three walks."""


def _foot(side: str, shank: float) -> Cone:
    """A cone from the heel to the toes, fixed to the shank, since the body has no joint at the ankle.

    It is the foot of somebody whose shank is so long, mm; its heel is a quarter of its length behind the ankle.
    """
    stature = shank / LENGTH_SHARES["shank"]
    size = segment_lengths(stature)
    heel = (0.0, -0.25 * size["foot"], -shank - size["ankle_height"])
    return Cone(f"foot_{side}", f"knee_{side}", size["foot"], segment_radii(stature)["foot"], origin=heel, axis=TOES)
