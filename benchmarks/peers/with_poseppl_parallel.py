"""The job of a long series in poseppl: Kalman filter and smoother, parallel in time."""

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from job_gradient import DECAY, DIMENSION, LOG_NOISE, VARIANCE, rotation

import poseppl
from poseppl.smoothers import smoothed_moments

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "parallel in time", "job_parallel"


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.zeros(DIMENSION), 1.0).to_event(1))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(jnp.asarray(DECAY * rotation()) @ state["x"], VARIANCE**0.5).to_event(1))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"], jnp.exp(LOG_NOISE)).to_event(1))


def prepare(data, parallel=True):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    smooth = jax.jit(lambda seen: smoothed_moments(model, seen, parallel=parallel).mean)
    seen = jax.tree.map(jnp.asarray, model.observe({"z": data}))
    return lambda seed: jax.block_until_ready(smooth(seen))
