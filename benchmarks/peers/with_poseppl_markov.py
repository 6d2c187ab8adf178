"""The job of hidden states in poseppl: the likelihood's maximum by the gradient of the exact filter."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from job_markov import START

import poseppl
from poseppl.filters import hidden_markov_filter

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "`fit`, hidden Markov filter", "job_markov"


def parameters():
    numpyro.sample("stay", dist.Beta(2.0, 2.0).expand([2]).to_event(1))
    numpyro.sample("mean", dist.Normal(jnp.zeros(2), 2.0).to_event(1))
    numpyro.sample("scale", dist.LogNormal(jnp.zeros(2), 1.0).to_event(1))


def initial(params, inputs):
    numpyro.sample("state", dist.Bernoulli(0.5))


def transition(params, state, inputs):
    numpyro.sample("state", dist.Bernoulli(jnp.where(state["state"] == 1, params["stay"][1], 1 - params["stay"][0])))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(params["mean"][state["state"]], params["scale"][state["state"]]))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()
    start = {"stay": START[:2], "mean": START[2:4], "scale": START[4:]}

    def run(seed):
        found = poseppl.fit(model, {"z": data}, hidden_markov_filter, start=start)["estimate"]
        return np.concatenate([found[name] for name in start])

    return run
