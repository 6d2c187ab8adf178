"""The job in smcx, which has no particle smoother but its genealogy: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
import jax.numpy as jnp
import smcx
from job import DECAY, NOISE, STEP

NAME, PACKAGE, METHOD = "smcx", "smcx", "Kalman, Rauch-Tung-Striebel"


def prepare(data):
    one = jnp.ones((1, 1))

    @jax.jit
    def smooth(data):
        filtered = smcx.kalman_filter(jnp.zeros(1), one, DECAY * one, STEP**2 * one, one, NOISE**2 * one, data)
        return smcx.rts_smoother(filtered, DECAY * one).smoothed_means[:, 0]

    data = jnp.asarray(data, jnp.float32)[:, None]
    return lambda seed: jax.block_until_ready(smooth(data))
