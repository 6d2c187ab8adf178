"""The job in dynamax, which has no particle smoother: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_smoother
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from job import DECAY, NOISE, STEP

NAME, PACKAGE, METHOD = "dynamax", "dynamax", "Kalman, Rauch-Tung-Striebel"


def prepare(data):
    one = jnp.ones((1, 1))
    params = make_lgssm_params(jnp.zeros(1), one, DECAY * one, STEP**2 * one, one, NOISE**2 * one)
    smooth = jax.jit(lambda data: lgssm_smoother(params, data).smoothed_means[:, 0])
    data = jnp.asarray(data)[:, None]
    return lambda seed: jax.block_until_ready(smooth(data))
