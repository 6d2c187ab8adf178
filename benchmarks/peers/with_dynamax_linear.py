"""The job in 28 dimensions in dynamax: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_smoother
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from job_linear import DIMENSION, SEEN, VARIANCE, matrix

NAME, PACKAGE, METHOD, JOB = "dynamax", "dynamax", "Kalman, Rauch-Tung-Striebel", "job_linear"


def prepare(data):
    one, seen = jnp.eye(DIMENSION), jnp.eye(SEEN)
    A = jnp.asarray(matrix(), jnp.float32)
    params = make_lgssm_params(jnp.zeros(DIMENSION), one, A, VARIANCE * one, one[:SEEN], VARIANCE * seen)
    smooth = jax.jit(lambda data: lgssm_smoother(params, data)[3:5])
    data = jnp.asarray(data, jnp.float32)
    return lambda seed: jax.block_until_ready(smooth(data))[0]
