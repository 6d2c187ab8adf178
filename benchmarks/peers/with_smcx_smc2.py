"""The job of parameters in smcx: SMC² with a bootstrap filter, in logarithms."""

import jax
import jax.numpy as jnp
import smcx
from jax.scipy.stats import norm
from job import DECAY
from job_pmmh import NUM_PARAMS, NUM_PARTICLES, PRIOR

NAME, PACKAGE, METHOD, JOB = "smcx", "smcx", "SMC², bootstrap filter", "job_smc2"


def prepare(data):
    mean, deviation = jnp.asarray(PRIOR.T, jnp.float32)
    data = jnp.asarray(data, jnp.float32)

    def run(seed):
        found = smcx.smc2(
            jax.random.key(seed),
            lambda key, count: mean + deviation * jax.random.normal(key, (count, 2)),
            lambda theta: norm.logpdf(theta, mean, deviation).sum(),
            lambda key, count, theta: jax.random.normal(key, (count, 1)),
            lambda key, x, theta: DECAY * x + jnp.exp(theta[0]) * jax.random.normal(key, x.shape),
            lambda z, x, theta: norm.logpdf(z, x, jnp.exp(theta[1])).sum(),
            data,
            NUM_PARAMS,
            NUM_PARTICLES,
            num_pmmh_steps=3,
        )
        return jnp.exp(found.filtered_log_weights[-1]) @ found.filtered_params[-1]

    return run
