"""The job of a long series in dynamax: Kalman filter and smoother, one frame after the other."""

import jax
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_smoother
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

NAME, PACKAGE, METHOD, JOB = "dynamax", "dynamax", "one after the other", "job_parallel"


def prepare(data):
    one = jnp.eye(DIMENSION)
    A = jnp.asarray(DECAY * rotation(), jnp.float32)
    params = make_lgssm_params(jnp.zeros(DIMENSION), one, A, VARIANCE * one, one, jnp.exp(2 * LOG_NOISE) * one)
    smooth = jax.jit(lambda data: lgssm_smoother(params, data).smoothed_means)
    data = jnp.asarray(data)
    return lambda seed: jax.block_until_ready(smooth(data))
