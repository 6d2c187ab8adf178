"""The job of hidden states in poseppl: SciPy's optimiser on the likelihood of the exact filter and its gradient."""

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.special import expit, logit
from job_markov import START
from scipy.optimize import minimize

import poseppl

NAME, PACKAGE, METHOD, JOB = "poseppl", "poseppl", "gradient of `log_likelihood`", "job_markov"


def initial(params, inputs):
    numpyro.sample("state", dist.Bernoulli(0.5))


def transition(params, state, inputs):
    numpyro.sample("state", dist.Bernoulli(jnp.where(state["state"] == 1, params["stay"][1], 1 - params["stay"][0])))


def observation(params, state, inputs):
    numpyro.sample("z", dist.Normal(params["mean"][state["state"]], params["scale"][state["state"]]))


def prepare(data):
    start = {"stay": jnp.array(START[:2]), "mean": jnp.array(START[2:4]), "scale": jnp.array(START[4:])}
    model = poseppl.StateSpaceModel(initial, transition, observation).compile(params=start)
    seen = model.observe({"z": data})

    def params(u):
        return {"stay": expit(u[:2]), "mean": u[2:4], "scale": jnp.exp(u[4:])}

    @jax.jit
    @jax.value_and_grad
    def loss(u):
        return -poseppl.log_likelihood(model, params(u), seen, poseppl.filters.hidden_markov_filter)

    begin = np.concatenate([logit(start["stay"]), start["mean"], jnp.log(start["scale"])])

    def run(seed):
        found = params(minimize(loss, begin, jac=True, method="L-BFGS-B").x)
        return np.concatenate([found["stay"], found["mean"], found["scale"]])

    return run
