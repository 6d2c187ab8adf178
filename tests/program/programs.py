"""Programs for the tests of the compiler."""

from __future__ import annotations

import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel


def initial(params, inputs):
    numpyro.sample("level", dist.Normal(0.0, 1.0))
    numpyro.sample("slope", dist.Normal(0.0, 1.0).expand([2]))


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(state["level"], 0.5))
    numpyro.sample("slope", dist.Normal(state["slope"], 0.5))


def observation(params, state, inputs):
    numpyro.sample("height", dist.Normal(state["level"], 1.0))


def model(initial=initial, transition=transition, observation=observation, parameters=None):
    """The model of these programs, any of them replaced."""
    return StateSpaceModel(initial, transition, observation, parameters)
