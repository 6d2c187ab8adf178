"""The body of Du and Guan (ICASSP 2006, section 3): 24 degrees of freedom and 14 segments.

Six for the place and orientation of the root. The paper does not say which the others are, nor which segments are spheres;
chosen here: 2 for the head (nodding and turning), 3 for shoulders and hips, 1 for elbows and knees; torso and head, upper
arms, forearms and hands, thighs, shanks and feet. All are truncated cones: what it draws as spheres are short wide cones
here.

>>> body = du_guan_body()
>>> body.tree.dimension, len(body.flesh.names)
(24, 14)
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_models.bodies.anthropometry import STATURE
from poseppl_models.bodies.cone_body import ConeBody, proportional_body

AXES = {"pelvis": "ZYX", "neck": "ZX", "shoulder": "ZYX", "elbow": "X", "hip": "ZYX", "knee": "X"}


def du_guan_body(stature: float = STATURE, lengths: Mapping[str, float] | None = None) -> ConeBody:
    """Build the body of a person so tall (mm); segments whose lengths (mm) were measured take these."""
    return proportional_body(stature, lengths, AXES, ("upper_arm", "forearm", "hand", "thigh", "shank", "foot"))
