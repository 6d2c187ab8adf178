"""On which side a hinge is bent: a limb that turns by half a turn about its first bone, and bends the other way, stays there.

Nothing that is seen of its joints tells these two poses of a limb apart, and a pose without joint limits may be either, or
change from one to the other where the limb is straight. People have that in which the limb is bent to its side at rest.
"""

from __future__ import annotations

import jax
import numpy as np
from jax import Array

from poseppl.compilation import jit
from poseppl.motion.geometry.kinematic_jumps import Limb, limbs_of, mirrored_bend
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.particles.weights import weighted_mean


@jit
def bent_as_at_rest(tree: KinematicTree, rest: Array, states: Array, log_weights: Array) -> Array:
    """The same places of all joints, each hinge of a limb bent to its side at rest.

    Args:
        tree: Its limbs (:func:`poseppl.motion.geometry.kinematic_jumps.limbs_of`) are concerned.
        rest: The rest pose (d,), radians; a hinge that is straight there has no side, and stays as it is.
        states: Draws (T, N, d).
        log_weights: Of the draws (T, N): angles of a ball joint are those nearest to the weighted mean of the frame before.
    """
    for limb in limbs_of(tree):
        if limb.hinge is not None:
            states = _limb_bent(tree, limb, rest, states, log_weights)
    return states


def _limb_bent(tree: KinematicTree, limb: Limb, rest: Array, states: Array, log_weights: Array) -> Array:
    ball = np.array(tree.angle_index[limb.ball])

    def frame(before: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        drawn, log_weight = now
        bent = jax.vmap(lambda state: mirrored_bend(tree, limb, state, rest, before))(drawn)
        return weighted_mean(bent, log_weight)[ball], bent

    bent: Array = jax.lax.scan(frame, rest[ball].astype(states.dtype), (states, log_weights))[1]
    return bent
