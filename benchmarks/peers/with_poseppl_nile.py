"""The likelihood's maximum in poseppl."""

import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist

import poseppl

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "`fit`, diffuse Kalman", "job_nile"


def parameters():
    numpyro.sample("noise", dist.LogNormal(9.0, 2.0))
    numpyro.sample("step", dist.LogNormal(7.0, 2.0))


def initial(params, inputs):
    numpyro.sample("level", poseppl.Diffuse())


def transition(params, state, inputs):
    numpyro.sample("level", dist.Normal(state["level"], jnp.sqrt(params["step"])))


def observation(params, state, inputs):
    numpyro.sample("flow", dist.Normal(state["level"], jnp.sqrt(params["noise"])))


def prepare(data):
    model = poseppl.StateSpaceModel(initial, transition, observation, parameters).compile()

    def run(seed):
        found = poseppl.fit(model, {"flow": data}, poseppl.kalman_filter, num_starts=1)["estimate"]
        return [found["noise"].item(), found["step"].item()]

    return run
