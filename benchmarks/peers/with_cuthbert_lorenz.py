"""The chaotic job in cuthbert: ensemble Kalman filter, data perturbed. The first frame's transition draws the first state."""

import jax
import jax.numpy as jnp
from cuthbert import filter
from cuthbert.ensemble_kalman import ensemble_kalman_filter
from job_lorenz import DIMENSION, NOISE, NUM_MEMBERS, STEP, advance, start

NAME, PACKAGE, METHOD, JOB = "cuthbert", "cuthbert", "ensemble Kalman, stochastic", "job_lorenz"


def prepare(data):
    inputs = jnp.arange(len(data)) == 0, jnp.asarray(data, jnp.float32)
    mean, noise = jnp.asarray(start(), jnp.float32), NOISE * jnp.eye(DIMENSION // 2)

    def dynamics(inputs):
        def move(x, key):
            drawn = jax.random.normal(key, x.shape)
            return jnp.where(inputs[0], mean + drawn, advance(x, jnp) + STEP * drawn)

        return move

    forward = ensemble_kalman_filter.build_filter(
        init_sample=lambda key: jax.random.normal(key, (DIMENSION,)),
        get_dynamics=dynamics,
        get_observations=lambda inputs: (lambda x: x[::2], noise, inputs[1]),
        n_particles=NUM_MEMBERS,
    )

    @jax.jit
    def run(key):
        keys = jax.random.split(key)
        return filter(forward, inputs, forward.init_prepare(key=keys[0]), key=keys[1]).mean[1:]

    return lambda seed: jax.block_until_ready(run(jax.random.key(seed)))
