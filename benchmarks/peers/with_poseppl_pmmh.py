"""The job of parameters in poseppl: PMMH with a bootstrap filter."""

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
from job import DECAY
from job_pmmh import NUM_DRAWS, NUM_PARTICLES, NUM_WARMUP, PRIOR

import poseppl

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "`fit`, PMMH, bootstrap filter", "job_pmmh"
CHAIN = {"method": "pmmh", "num_chains": 1, "num_draws": NUM_DRAWS, "num_warmup": NUM_WARMUP}


def parameters():
    numpyro.sample("step", dist.LogNormal(*PRIOR[0]))
    numpyro.sample("noise", dist.LogNormal(*PRIOR[1]))


def initial(params, inputs):
    numpyro.sample("x", dist.Normal(0.0, 1.0))


def transition(params, state, inputs):
    numpyro.sample("x", dist.Normal(DECAY * state["x"], params["step"]))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(state["x"], params["noise"]))


def bootstrap(model):
    return poseppl.particle_filter(model, NUM_PARTICLES)


def prepare(data, **settings):
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()

    def run(seed):
        draws = poseppl.fit(model, {"z": data}, bootstrap, jax.random.key(seed), **(settings or CHAIN))["posterior"]
        return np.array([np.log(draws[name].values).mean() for name in ("step", "noise")])

    return run
