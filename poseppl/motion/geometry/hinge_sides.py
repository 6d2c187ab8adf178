"""On which side a hinge is bent: a limb that turns by half a turn about its first bone, and bends the other way, stays there.

The joints of both poses of a limb look the same. A pose without joint limits may be either, or change from one to the other
where the limb is straight. People have the pose whose limb bends to the same side as at rest.
"""

from __future__ import annotations

import jax
import numpy as np
from jax import Array

from poseppl.compilation import jit_lightly
from poseppl.motion.geometry.kinematic_jumps import limbs_of, mirrored_bend
from poseppl.motion.geometry.kinematics import Frames, frames_of
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.particles.weights import weighted_mean


@jit_lightly
def bent_as_at_rest(tree: KinematicTree, rest: Array, states: Array, log_weights: Array) -> Array:
    """The same places of all joints, each hinge of a limb bent to its side at rest.

    Args:
        tree: Its limbs (:func:`poseppl.motion.geometry.kinematic_jumps.limbs_of`) are concerned.
        rest: The rest pose (d,), radians; a hinge that is straight there has no side, and is left unchanged.
        states: Draws (T, N, d).
        log_weights: Log-weights of the draws (T, N). Angles of a ball joint are those nearest to the weighted mean of the
        frame before.
    """
    limbs = [limb for limb in limbs_of(tree) if limb.hinge is not None]
    last = jax.tree.map(lambda leaf: leaf[..., None], tree)

    def bent(state: Array, frames: Frames, before: Array) -> Array:
        for limb in limbs:
            state = mirrored_bend(tree, limb, state, frames, rest, before[np.array(tree.angle_index[limb.ball])])
        return state

    def frame(before: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        drawn, log_weight = now
        moved = jax.vmap(bent, in_axes=(0, -1, None))(drawn, frames_of(last, drawn.T), before)
        return weighted_mean(moved, log_weight), moved

    whole: Array = jax.lax.scan(frame, rest.astype(states.dtype), (states, log_weights))[1]
    return whole
