"""Problems of another kind: counts of a positive rate on a grid, a chain of sites, a state of which a part is known."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import scipy.stats
from law_problems import Problem
from oracles.grid import grid_filter_smoother
from oracles.kalman import KalmanResult, kalman_filter, rauch_tung_striebel
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices
from smoothing_problems import Smoothing

from poseppl.program import Clamped, StateSpaceModel, clamp

COUNTS = np.array([3.0, 9.0, np.nan, 1.0])


def observation(params, state, inputs):
    numpyro.sample("count", dist.Poisson(state["rate"]))


def positive():
    """The rate itself is the state: its bijector is the logarithm."""

    def initial(params, inputs):
        numpyro.sample("rate", dist.LogNormal(1.0, 0.8))

    def transition(params, state, inputs):
        numpyro.sample("rate", dist.LogNormal(0.9 * jnp.log(state["rate"]), 0.5))

    return StateSpaceModel(initial, transition, observation)


def counted():
    """The problem of the counts, its exact answer from a grid over the logarithm of the rate."""
    grid, filtered, _, evidence = counts_on_grid()
    exact = KalmanResult(*moments_on_grid(grid, filtered), None, None, evidence)
    model = positive().compile()
    return Problem(None, model, model.observe({"count": COUNTS}), jnp.zeros(len(COUNTS)), exact)


def counted_and_smoothed():
    """The same for smoothers."""
    posed = counted()
    grid, _, smoothed, _ = counts_on_grid()
    return Smoothing(posed.model, posed.observations, posed.inputs, *moments_on_grid(grid, smoothed))


def counts_on_grid():
    """The grid (G,), filtered and smoothed probabilities (T, G), evidence increments (T,)."""
    grid = np.linspace(-5.0, 7.0, 1201)
    log_transition = scipy.stats.norm(0.9 * grid[:, None], 0.5).logpdf(grid)
    rate, seen = np.exp(grid), np.isfinite(COUNTS)
    log_likelihoods = np.where(seen[:, None], scipy.stats.poisson(rate).logpmf(np.nan_to_num(COUNTS)[:, None]), 0.0)
    initial = scipy.stats.norm(1.0, 0.8).logpdf(grid)
    return grid, *grid_filter_smoother(grid, initial, lambda t: log_transition, log_likelihoods)


def moments_on_grid(grid, probabilities):
    """Means (T, 1) and variances (T, 1, 1)."""
    means = probabilities @ grid
    return means[:, None], (probabilities * (grid - means[:, None]) ** 2).sum(1)[:, None, None]


def moving():
    """A position that this frame's velocity moves: a chain of sites, whose joint Gaussian is written out for the oracle."""

    def initial(params, inputs):
        velocity = numpyro.sample("velocity", dist.Normal(1.0, 0.8))
        numpyro.sample("position", dist.Normal(0.5 * velocity, 0.7))

    def transition(params, state, inputs):
        velocity = numpyro.sample("velocity", dist.Normal(0.9 * state["velocity"], 0.6))
        numpyro.sample("position", dist.Normal(state["position"] + 0.5 * velocity, 0.3))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["position"], 0.4))

    chain, beside = np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([[0.9, 0.0], [0.0, 1.0]])
    matrices = linear_gaussian_matrices(
        A=chain @ beside,
        Q=chain @ np.diag([0.36, 0.09]) @ chain.T,
        H=[[0.0, 1.0]],
        R=[[0.16]],
        m=chain @ [1.0, 0.0],
        P=chain @ np.diag([0.64, 0.49]) @ chain.T,
    )
    ys = np.array([[0.9], [1.8], [np.nan], [1.2], [-0.4]])
    exact = kalman_filter(matrices, np.nan_to_num(ys), np.isfinite(ys))
    model = StateSpaceModel(initial, transition, observation).compile()
    return Problem(matrices, model, model.observe({"y": ys[:, 0]}), jnp.zeros(len(ys)), exact)


A = np.array([[0.9, 0.2], [-0.1, 0.8]])
PUSH_BEFORE, PUSH_NOW = np.array([0.5, -0.4]), np.array([-0.3, 0.2])
H = np.array([[1.0, 0.0], [1.0, 1.0]])


def pushed():
    """Two coordinates, pushed by a third one's last and present value."""

    def initial(params, inputs):
        numpyro.sample("u", dist.Normal(0.0, 1.0))
        numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.0).to_event(1))

    def transition(params, state, inputs):
        u = numpyro.sample("u", dist.Normal(0.7 * state["u"], 0.4))
        mean = A @ state["x"] + PUSH_BEFORE * state["u"] + PUSH_NOW * u
        numpyro.sample("x", dist.Normal(mean, jnp.sqrt(0.5)).to_event(1))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(H @ state["x"], jnp.sqrt(0.3)).to_event(1))

    return StateSpaceModel(initial, transition, observation)


def clamped():
    """The third coordinate is known at every frame: Kalman's inputs."""
    known = np.array([0.5, -2.0, 1.5, 3.0])
    ys = np.array([[0.4, 0.1], [0.2, -0.8], [np.nan, np.nan], [1.0, 2.0]])
    inputs = np.concatenate([np.zeros((1, 2)), np.stack([known[:-1], known[1:]], 1)])
    free = linear_gaussian_matrices(
        2, A=A, H=H, B=np.stack([PUSH_BEFORE, PUSH_NOW], 1), P=np.eye(2), Q=0.5 * np.eye(2), R=0.3 * np.eye(2)
    )
    exact = kalman_filter(free, np.nan_to_num(ys), np.isfinite(ys), inputs)
    full = pushed().compile()
    trajectory = np.concatenate([known[:, None], np.zeros((4, 2))], 1)
    given = Clamped.of_trajectory(jnp.asarray(trajectory, jnp.float32), None)
    return Problem(free, clamp(full, ["x"]), full.observe({"y": ys}), given, exact)


def clamped_and_smoothed():
    """The same for smoothers."""
    posed = clamped()
    exact = rauch_tung_striebel(posed.matrices, posed.exact)
    return Smoothing(posed.model, posed.observations, posed.inputs, *exact)
