"""The gradient job in dynamax: the Kalman filter's marginal log-likelihood, differentiated by JAX."""

import jax
import jax.numpy as jnp
from dynamax.linear_gaussian_ssm import lgssm_filter
from dynamax.linear_gaussian_ssm.inference import make_lgssm_params
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

NAME, PACKAGE, METHOD, JOB = "dynamax", "dynamax", "Kalman: value and gradient", "job_gradient"


def prepare(data):
    one, R, data = jnp.eye(DIMENSION), jnp.asarray(rotation(), jnp.float32), jnp.asarray(data, jnp.float32)

    def evidence(decay, log_noise):
        noise = jnp.exp(2 * log_noise) * one
        params = make_lgssm_params(jnp.zeros(DIMENSION), one, decay * R, VARIANCE * one, one, noise)
        return lgssm_filter(params, data).marginal_loglik

    both = jax.jit(jax.value_and_grad(evidence, (0, 1)))

    def run(seed):
        value, slope = both(jnp.float32(DECAY), jnp.float32(LOG_NOISE))
        return [value, *slope]

    return run
