"""The likelihood's maximum in dynestyx: a local level from N(1000, 1e7), whose gradient SciPy's BFGS follows."""

import dynestyx as dsx
import jax
import jax.numpy as jnp
import numpy as np
from dynestyx.inference.configs.filter import KFConfig
from scipy.optimize import minimize

NAME, PACKAGE, METHOD, JOB = "dynestyx", "dynestyx", "Kalman from a wide prior, BFGS", "job_nile"


def prepare(data):
    jax.config.update("jax_enable_x64", True)
    one, times = jnp.ones((1, 1)), jnp.arange(len(data))
    start = jnp.array([1000.0])

    @jax.jit
    @jax.value_and_grad
    def loss(u, data):
        noise, step = jnp.exp(u)
        model = dsx.LTI_discrete(A=one, Q=step * one, H=one, R=noise * one, initial_mean=start, initial_cov=1e7 * one)
        with dsx.Filter(KFConfig()):
            return -dsx.condition("level", model, obs_times=times, obs_values=data).marginal_loglik

    data = jnp.asarray(data)[:, None]
    return lambda seed: np.exp(minimize(loss, np.array([9.0, 7.0]), args=(data,), jac=True).x)
