"""The job of regimes in poseppl: the likelihood's maximum by the gradient of the exact filter; data come back as `previous`."""

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from job_regimes import START

import poseppl
from poseppl.filters import hidden_markov_filter

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "`fit`, hidden Markov filter", "job_regimes"


def parameters():
    numpyro.sample("stay", dist.Beta(2.0, 2.0).expand([2]).to_event(1))
    numpyro.sample("slope", dist.Normal(jnp.zeros(2), 1.0).to_event(1))
    numpyro.sample("intercept", dist.Normal(jnp.zeros(2), 1.0).to_event(1))
    numpyro.sample("scale", dist.LogNormal(jnp.zeros(2), 1.0).to_event(1))


def initial(params, inputs):
    numpyro.sample("regime", dist.Bernoulli(0.5))


def transition(params, state, inputs, previous):
    numpyro.sample("regime", dist.Bernoulli(jnp.where(state["regime"] == 1, params["stay"][1], 1 - params["stay"][0])))


def observation(params, state, inputs, previous):
    slope, intercept, scale = (params[name][state["regime"]] for name in ("slope", "intercept", "scale"))
    numpyro.sample("y", dist.Normal(slope * previous["y"][-1] + intercept, scale))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters, before={"y": [0.0]}).compile()
    start = dict(zip(("stay", "slope", "intercept", "scale"), START.reshape(4, 2), strict=True))

    def run(seed):
        found = poseppl.fit(model, {"y": data}, hidden_markov_filter, start=start)["estimate"]
        return np.concatenate([found[name] for name in start])

    return run
