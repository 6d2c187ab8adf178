"""The body of Darby, Li and Costen (2008, doi:10.1109/AFGR.2008.4813348, section 3): 31 coordinates and 10 truncated cones.

"Position and orientation of the torso and the relative joint angles between limbs": 6 for the pelvis; the paper leaves the
other 25 to its references. Taken here as in the software of Balan, Sigal and Black (2005) that its results are compared
with: 2 between pelvis and thorax, 3 for the neck, 2 for each clavicle, 3 for shoulders and hips, 1 for elbows and knees.
Hands and feet have no cones.

>>> body = darby_body()
>>> body.tree.dimension, len(body.flesh.names)
(31, 10)
"""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_models.bodies.anthropometry import STATURE
from poseppl_models.bodies.cone_body import ConeBody, proportional_body

AXES = {
    "pelvis": "ZYX",
    "thorax": "ZX",
    "neck": "ZYX",
    "clavicle": "ZY",
    "shoulder": "ZYX",
    "elbow": "X",
    "hip": "ZYX",
    "knee": "X",
}


def darby_body(stature: float = STATURE, lengths: Mapping[str, float] | None = None) -> ConeBody:
    """Build the body of a person so tall (mm); segments whose lengths (mm) were measured take these."""
    return proportional_body(stature, lengths, AXES, ("upper_arm", "forearm", "thigh", "shank"))
