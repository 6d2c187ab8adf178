"""The job of a long series in smcx: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
import jax.numpy as jnp
import smcx
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

NAME, PACKAGE, METHOD, JOB = "smcx", "smcx", "one after the other", "job_parallel"


def prepare(data):
    one, A = jnp.eye(DIMENSION), jnp.asarray(DECAY * rotation(), jnp.float32)

    @jax.jit
    def smooth(data):
        filtered = smcx.kalman_filter(jnp.zeros(DIMENSION), one, A, VARIANCE * one, one, jnp.exp(2 * LOG_NOISE) * one, data)
        return smcx.rts_smoother(filtered, A).smoothed_means

    data = jnp.asarray(data)
    return lambda seed: jax.block_until_ready(smooth(data))
