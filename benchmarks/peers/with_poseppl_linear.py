"""The job in 28 dimensions in poseppl, the formula alone: Kalman filter, Rauch-Tung-Striebel smoother."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from job_linear import DIMENSION, SEEN, VARIANCE, matrix

import poseppl
from poseppl.smoothers import smoothed_moments

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "Kalman, Rauch-Tung-Striebel: the formula", "job_linear"
A, SCALE = jnp.asarray(matrix(), jnp.float32), np.sqrt(VARIANCE)


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(jnp.zeros(DIMENSION), 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(A @ state["x"], SCALE))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"][:SEEN], SCALE))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation).compile()
    observations = jax.tree.map(jnp.asarray, model.observe({"z": data}))
    smooth = jax.jit(lambda observations: smoothed_moments(model, observations))
    return lambda seed: jax.block_until_ready(smooth(observations)).mean
