"""Poses whose limbs are bent to the wrong side, with all joints where they were."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Booleans, Floats
from poseppl.motion.bodies.body import Body

LIMBS = {"shoulder_l": "elbow_l", "shoulder_r": "elbow_r", "hip_l": "knee_l", "hip_r": "knee_r"}


def backwards(body: Body, states: Floats, chosen: Booleans) -> Floats:
    """States (T, d) whose limbs, where chosen (T, 4), turn by half a turn about their first bone, and bend the other way."""
    found, names = states.copy(), body.tree.coordinates
    for limb, (ball, hinge) in enumerate(LIMBS.items()):
        rows, turned = chosen[:, limb], [names.index((ball, axis)) for axis in "ZYX"]
        rotations = Rotation.from_euler("ZYX", states[:, turned][rows]) * Rotation.from_euler("z", np.pi)
        found[np.ix_(rows, turned)] = rotations.as_euler("ZYX")
        found[rows, names.index((hinge, "X"))] *= -1
    return found
