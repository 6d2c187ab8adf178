"""Joint angles of people: limits, as data, as a hard constraint and as a smooth barrier; usual postures.

The ranges are those of healthy adults by the American Academy of Orthopaedic Surgeons (*Joint Motion: Method of Measuring and
Recording*, 1965), taken axis by axis. They are wide, as Peursum et al. (2010, section 3.4) require: right for most motions and
specific to none. Our source is tables that cite the book. Shoulder, elbow and forearm (flexion 180, extension 60, abduction
180; 0 to 150; 80 both ways) were compared with Norkin and White, *Measurement of Joint Motion: A Guide to Goniometry*, Table
A.1, and the knee's 135 with such a table; neck, trunk, hip and ankle agree with physiotherapists' tables that name no source.
Our own choices are 5 degrees of hyperextension at elbows and knees, and a right angle both ways for the rotation of the upper
arm about the vertical. (The book measures this rotation, 70 inwards and 90 outwards, with a lifted arm.) The clavicle is not in
the book: 45 degrees up, 10 down, 30 forwards and back are the largest that textbooks of kinesiology give (15 to 30 forwards and
back). Signs are those of :mod:`poseppl_models.bodies.cone_body`.

Outside of the limits the hard log-factor is -inf; the barrier is, for widths s,

    log b(x) = sum over coordinates (log sigmoid((x - low) / s) + log sigmoid((high - x) / s)),

which tends to the hard one as s goes to 0, and pulls with the force 1 / s outside.

Usual postures are mean and standard deviation of angles, radians, in recordings of walks, of punches and of bending over, each
of which counts as much, and their mirror images; 0.05 is added to the deviations in quadrature, for skeletons differ. ``python
-m studies.postures`` prints them. There is no run, jump or dance among the recordings. The head's turn about itself is left
out: its markers do not show it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.motion.geometry import KinematicTree
from poseppl_models.bodies.joint_names import mirrored_angle

LIMIT_WIDTH = 0.05
"""Radians over which the smooth limits set in."""
DEGREES: Mapping[tuple[str, str], tuple[float, float]] = {
    ("thorax", "X"): (-80, 30),
    ("thorax", "Y"): (-35, 35),
    ("thorax", "Z"): (-45, 45),
    ("neck", "X"): (-45, 45),
    ("neck", "Y"): (-45, 45),
    ("neck", "Z"): (-60, 60),
    ("clavicle", "Y"): (-10, 45),
    ("clavicle", "Z"): (-30, 30),
    ("shoulder", "X"): (-60, 180),
    ("shoulder", "Y"): (-75, 180),
    ("shoulder", "Z"): (-90, 90),
    ("elbow", "X"): (-5, 150),
    ("elbow", "Z"): (-80, 80),
    ("hip", "X"): (-30, 120),
    ("hip", "Y"): (-30, 45),
    ("hip", "Z"): (-45, 45),
    ("knee", "X"): (-135, 5),
    ("ankle", "X"): (-50, 20),
}
"""Least and largest angle (degrees) of a joint about an axis, for the left side; the right one mirrors Y and Z."""


def joint_limits(tree: KinematicTree) -> Floats:
    """Limits (d, 2) in radians of the coordinates of a body; infinite for the root and for what the table leaves out."""
    limits = np.tile([-np.inf, np.inf], (tree.dimension, 1))
    for row, (joint, axis) in enumerate(tree.coordinates):
        name, _, side = joint.partition("_")
        if (name, axis) in DEGREES:
            low, high = np.radians(DEGREES[name, axis])
            limits[row] = (-high, -low) if side == "r" and axis in "YZ" else (low, high)
    return limits


def hard_limits(limits: Any, state: Array) -> Array:
    """0 where a state (d,) keeps to the limits (d, 2), -inf elsewhere: shape ()."""
    low, high = jnp.asarray(limits, state.dtype).T
    return jnp.where(jnp.all((state >= low) & (state <= high)), 0.0, -jnp.inf)


def smooth_limits(limits: Any, state: Array) -> Array:
    """Log-barrier () of a state (d,), at most 0, for limits (d, 2), that sets in over :data:`LIMIT_WIDTH`."""
    limited = np.flatnonzero(np.isfinite(np.asarray(limits)).all(1))
    low, high = jnp.asarray(np.asarray(limits)[limited], state.dtype).T
    angles = state[limited]
    return jnp.sum(jax.nn.log_sigmoid((angles - low) / LIMIT_WIDTH) + jax.nn.log_sigmoid((high - angles) / LIMIT_WIDTH))


LEFT: Mapping[tuple[str, str], tuple[float, float]] = {
    ("head", "Y"): (0.0, 0.13),
    ("head", "X"): (0.16, 0.15),
    ("pelvis", "Z"): (0.0, 0.08),
    ("pelvis", "Y"): (0.0, 0.14),
    ("girdle", "Z"): (0.0, 0.08),
    ("shoulder", "Z"): (0.14, 0.40),
    ("shoulder", "Y"): (0.21, 0.29),
    ("shoulder", "X"): (0.30, 0.74),
    ("elbow", "X"): (1.00, 0.59),
    ("hip", "Z"): (0.04, 0.18),
    ("hip", "Y"): (-0.05, 0.14),
    ("hip", "X"): (0.62, 0.71),
    ("knee", "X"): (-0.72, 0.47),
}
"""Mean and standard deviation of angles of the trunk and the left side, by joint and axis."""


def _both_sides() -> dict[tuple[str, str], tuple[float, float]]:
    means = {angle: mean for angle, (mean, _) in LEFT.items()}
    return {
        (name, axis): (mirrored_angle(means, name, axis), deviation)
        for (joint, axis), (_, deviation) in LEFT.items()
        for name in ((joint,) if joint in ("head", "pelvis", "girdle") else (f"{joint}_l", f"{joint}_r"))
    }


POSTURES: Mapping[tuple[str, str], tuple[float, float]] = _both_sides()
"""Those of all joints: on the right turns about Y and Z are the other way."""

_FOOT: Mapping[tuple[str, str], tuple[float, float]] = {("ankle", "X"): (0.12, 0.20), ("ankle", "Y"): (0.0, 0.14)}
"""Ankle and subtalar angle of the left foot in two walks and squats by OpenCap and by OpenSim (as above, 0.05 in quadrature),
each side as much; the mean inversion, whose sign differs between them, is 0."""
FOOT_POSTURES: Mapping[tuple[str, str], tuple[float, float]] = {
    (f"{joint}_{side}", axis): posture for (joint, axis), posture in _FOOT.items() for side in "lr"
}
"""Those of the ankles."""
