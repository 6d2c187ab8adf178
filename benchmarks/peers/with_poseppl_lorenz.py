"""The chaotic job in poseppl, means alone: ensemble Kalman filter, data perturbed."""

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from job_lorenz import NOISE, NUM_MEMBERS, STEP, advance, start

import poseppl
from poseppl.filters import ensemble_kalman_filter

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "ensemble Kalman, stochastic: means", "job_lorenz"
START = start()


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.asarray(START, jnp.float32), 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(advance(state["x"], jnp), STEP))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"][::2], NOISE))


def collect_mean(rng_key, state, info, inputs):
    return state.particles.mean(0)


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    filter = ensemble_kalman_filter(model, NUM_MEMBERS, form="stochastic")
    observations = model.observe({"z": data})
    return lambda seed: poseppl.run_filter(filter, jax.random.key(seed), observations, collect=collect_mean).outputs
