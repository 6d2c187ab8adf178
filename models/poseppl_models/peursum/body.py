"""The body of Peursum, Venkatesh and West (2010, section 3.4): 28 dimensions, loose cylinders or points, a fixed scale.

doi:10.1007/s11263-009-0205-5.

Position and heading of the root, and 24 rotations, the pitch of the body among them. Each part is a cylinder and fits
loosely, so that one body serves all sorts of people and clothes. The paper shows the parts in a drawing and gives no sizes;
chosen here: pitch, bends and turns at the waist (3), a nodding and turning head (2), three turns at shoulders and hips, one
at elbows, knees and ankles; 12 cylinders, the hands being part of the forearms; thicknesses a quarter more than the body's
own.

>>> body = peursum_body()
>>> body.tree.dimension, len(body.flesh.names)
(28, 12)

>>> body = full_body()
>>> body.tree.dimension, len(body.tree.marker_names)
(28, 15)
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl.motion.bodies.body import Body
from poseppl_models.bodies.anthropometry import STATURE, segment_lengths, segment_radii
from poseppl_models.bodies.cone_body import ConeBody, cone_body, fitted_stature, limb_cones, trunk_cones
from poseppl_models.darby.body import seen_as_points

LOOSENESS = 1.25
"""By how much cylinders are thicker than the segments within."""
SHORT_HAND = 0.5
"""Share of the hand that lengthens the forearm."""
AXES = {"pelvis": "ZX", "thorax": "ZYX", "neck": "ZX", "shoulder": "ZYX", "elbow": "X", "hip": "ZYX", "knee": "X", "ankle": "X"}


def peursum_body(scale: float = 1.0) -> ConeBody:
    """Build the body.

    Args:
        scale: Scale of the whole body, 1 for a stature of 1.75 m.
    """
    lengths = segment_lengths(scale * STATURE)
    middles = {name: LOOSENESS * sum(pair) / 2 for name, pair in segment_radii(scale * STATURE).items()}
    radii = {name: (radius, radius) for name, radius in middles.items()}
    reach = {**lengths, "forearm": lengths["forearm"] + SHORT_HAND * lengths["hand"]}
    limbs = limb_cones(reach, radii, ("upper_arm", "forearm", "thigh", "shank", "foot"))
    return cone_body(lengths, AXES, [*trunk_cones(lengths, radii), *limbs])


def full_body(lengths: Mapping[str, float] | None = None) -> Body:
    """Build the body in the size of a person; its proportions are fixed.

    Args:
        lengths: Segment lengths, mm, from which its stature follows.
    """
    sizes = segment_lengths() | dict(lengths or {})
    stature = fitted_stature({name: length for name, length in sizes.items() if name != "head"})
    return seen_as_points(peursum_body(stature / STATURE), sizes)
