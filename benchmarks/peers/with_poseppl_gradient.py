"""The gradient job in poseppl: `log_likelihood` of a Kalman filter, differentiated by JAX."""

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

import poseppl

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "Kalman: value and gradient", "job_gradient"
R = jnp.asarray(rotation(), jnp.float32)


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.zeros(DIMENSION), 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(params["decay"] * R @ state["x"], VARIANCE**0.5))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"], jnp.exp(params["log_noise"])))


def parameters():
    numpyro.sample("decay", dist.Normal(0.0, 1.0))
    numpyro.sample("log_noise", dist.Normal(0.0, 1.0))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()
    observed = jax.tree.map(jnp.asarray, model.observe({"z": data}))
    both = jax.jit(jax.value_and_grad(lambda params: poseppl.log_likelihood(model, params, observed, poseppl.kalman_filter)))

    def run(seed):
        value, slope = both({"decay": jnp.float32(DECAY), "log_noise": jnp.float32(LOG_NOISE)})
        return [value, slope["decay"], slope["log_noise"]]

    return run
