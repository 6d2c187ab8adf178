"""Models whose params have exact answers: a walk seen with noise, the flow of the Nile, and a chain of two states."""

from __future__ import annotations

from functools import cache

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from oracles.kalman import kalman_filter
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices

from poseppl.program import Diffuse, StateSpaceModel

YS = np.array([0.3, -1.1, 0.9, 2.0, np.nan, -0.6, 0.5, 1.8, 1.1, -0.4])
PRIOR = -0.5, 0.7
"""Mean and standard deviation of the log of the walk's noise."""


def walk_model():
    def parameters():
        numpyro.sample("noise", dist.LogNormal(*PRIOR))

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(0.8 * state["x"], 0.6))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], params["noise"]))

    return StateSpaceModel(initial, transition, observation, parameters).compile()


WALK = walk_model()


def walk_likelihood(u):
    """Log-likelihood of the log of the noise."""
    matrices = linear_gaussian_matrices(1, A=[[0.8]], Q=[[0.36]], R=[[np.exp(2 * u)]])
    return kalman_filter(matrices, np.nan_to_num(YS)[:, None], np.isfinite(YS)[:, None]).log_evidence.sum()


@cache
def walk_posterior():
    """Mean and variance of the log of the noise, and the log-evidence of the model, on a grid."""
    grid = np.linspace(-5.0, 3.0, 401)
    log_prior = -0.5 * ((grid - PRIOR[0]) / PRIOR[1]) ** 2 - np.log(PRIOR[1] * np.sqrt(2 * np.pi))
    log_joint = np.array([walk_likelihood(u) for u in grid]) + log_prior
    weights = np.exp(log_joint - log_joint.max())
    evidence = np.log(weights.sum() * (grid[1] - grid[0])) + log_joint.max()
    weights /= weights.sum()
    mean = weights @ grid
    return mean, weights @ (grid - mean) ** 2, evidence


def nile_model():
    def parameters():
        numpyro.sample("noise_variance", dist.LogNormal(9.0, 2.0))
        numpyro.sample("step_variance", dist.LogNormal(7.0, 2.0))

    def initial(params, inputs):
        numpyro.sample("level", Diffuse())

    def transition(params, state, inputs):
        numpyro.sample("level", dist.Normal(state["level"], jnp.sqrt(params["step_variance"])))

    def observation(params, state, inputs):
        numpyro.sample("flow", dist.Normal(state["level"], jnp.sqrt(params["noise_variance"])))

    return StateSpaceModel(initial, transition, observation, parameters).compile()


def chain_model():
    """Two hidden states seen through Gaussians of different means."""

    def parameters():
        numpyro.sample("stay", dist.Beta(2.0, 2.0).expand([2]).to_event(1))
        numpyro.sample("means", dist.Normal(jnp.array([-1.0, 1.0]), 1.0).to_event(1))

    def initial(params, inputs):
        numpyro.sample("busy", dist.Bernoulli(0.5))

    def transition(params, state, inputs):
        stay = params["stay"][state["busy"]]
        numpyro.sample("busy", dist.Bernoulli(jnp.where(state["busy"] == 1, stay, 1.0 - stay)))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(params["means"][state["busy"]], 0.7))

    return StateSpaceModel(initial, transition, observation, parameters).compile()


def chain_likelihood(stay, means, ys):
    """Its log-likelihood, by the forward recursion."""
    weights, total = np.array([0.5, 0.5]), 0.0
    moves = np.array([[stay[0], 1 - stay[0]], [1 - stay[1], stay[1]]])
    for t, y in enumerate(ys):
        weights = weights if t == 0 else weights @ moves
        if np.isfinite(y):
            weights = weights * np.exp(-0.5 * ((y - means) / 0.7) ** 2) / (0.7 * np.sqrt(2 * np.pi))
        total += np.log(weights.sum())
        weights = weights / weights.sum()
    return total


def hessian(function, point, width):
    """Central second differences (p, p)."""
    size, steps = len(point), np.eye(len(point)) * width
    values = [
        [
            sum(i * j * function(point + i * steps[a] + j * steps[b]) for i in (-1, 1) for j in (-1, 1)) / (4 * width**2)
            for b in range(size)
        ]
        for a in range(size)
    ]
    return np.array(values)
