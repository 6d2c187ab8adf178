"""The job of many series in dynamax: a Kalman filter of each, vectorised by JAX."""

import jax
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from job import DECAY, NOISE, STEP

NAME, PACKAGE, METHOD, JOB = "dynamax", "dynamax", "Kalman, 1,000 series: means", "job_series"


def prepare(data):
    one = jnp.ones((1, 1))
    params = make_lgssm_params(jnp.zeros(1), one, DECAY * one, STEP**2 * one, one, NOISE**2 * one)
    filter = jax.jit(jax.vmap(lambda data: lgssm_filter(params, data[:, None]).filtered_means[:, 0]))
    data = jnp.asarray(data, jnp.float32)
    return lambda seed: jax.block_until_ready(filter(data))
