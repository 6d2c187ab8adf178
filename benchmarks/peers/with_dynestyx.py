"""The job in dynestyx, whose particle smoother is cuthbert's: Kalman filter, Rauch-Tung-Striebel smoother."""

import dynestyx as dsx
import jax
import jax.numpy as jnp
from dynestyx.inference.configs.smoother import KFSmootherConfig
from job import DECAY, NOISE, STEP

NAME, PACKAGE, METHOD = "dynestyx", "dynestyx", "Kalman, Rauch-Tung-Striebel"


def prepare(data):
    one = jnp.ones((1, 1))
    model = dsx.LTI_discrete(A=DECAY * one, Q=STEP**2 * one, H=one, R=NOISE**2 * one)

    @jax.jit
    def smooth(data):
        with dsx.Smoother(KFSmootherConfig()):
            found = dsx.condition("level", model, obs_times=jnp.arange(len(data)), obs_values=data)
        return jnp.stack([each.mean[0] for each in found.dists])

    data = jnp.asarray(data, jnp.float32)[:, None]
    return lambda seed: jax.block_until_ready(smooth(data))
