"""The job of a long series in cuthbert: square-root Kalman filter and smoother, parallel in time.

Its time 0 has no data, so the first transition forgets it and draws the first state.
"""

import jax
import jax.numpy as jnp
from cuthbert import filter, smoother
from cuthbert.gaussian import kalman
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

NAME, PACKAGE, METHOD, JOB = "cuthbert", "cuthbert", "parallel in time", "job_parallel"


def prepare(data, parallel=True):
    zero, one = jnp.zeros(DIMENSION), jnp.eye(DIMENSION)
    A = jnp.asarray(DECAY * rotation(), jnp.float32)

    def dynamics(inputs):
        return jnp.where(inputs[0], 0.0, A), zero, jnp.where(inputs[0], 1.0, VARIANCE**0.5) * one

    forward = kalman.build_filter(zero, one, dynamics, lambda inputs: (one, zero, jnp.exp(LOG_NOISE) * one, inputs[1]))
    backward = kalman.build_smoother(dynamics)

    @jax.jit
    def smooth(inputs):
        states = filter(forward, inputs, forward.init_prepare(), parallel=parallel)
        return smoother(backward, states, parallel=parallel).mean[1:]

    inputs = jnp.arange(len(data)) == 0, jnp.asarray(data)
    return lambda seed: jax.block_until_ready(smooth(inputs))
