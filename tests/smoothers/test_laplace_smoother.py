"""Laplace's approximation of a whole trajectory: robust sites, and where it stops being right. Exactness: the laws."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from poseppl_models.toys.finite_hmm import finite_hmm
from scipy.optimize import minimize

from poseppl.gaussians.block_tridiagonal import BlockTridiagonal, block_cholesky, marginal_covariances
from poseppl.program import Lorentzian, Observation, StateSpaceModel
from poseppl.runs.simulation import draw_sequence
from poseppl.smoothers import History, laplace_smoother
from poseppl.smoothers.curvature import safe_cholesky

STEP, NOISE, STRENGTH = 0.3, 0.5, 4.0
DATA = np.array([0.1, 0.3, 6.0, 0.2, 0.4, np.nan, 0.9])


def robust_walk(step: float = STEP) -> StateSpaceModel:
    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(state["x"], step))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("y", Lorentzian(dist.Normal(state["x"], NOISE), STRENGTH))

    return StateSpaceModel(initial, transition, observation)


def energy(x: Any) -> float:
    squared = np.square((DATA - x) / NOISE)[np.isfinite(DATA)]
    steps = np.sum(np.diff(x) ** 2) / STEP**2 + x[0] ** 2
    return float(0.5 * steps + 0.5 * STRENGTH * np.sum(np.log1p(squared / STRENGTH)))


def smoothed(num_draws: int, num_mode_steps: int = 20) -> Any:
    model = robust_walk().compile()
    blank = jnp.zeros((len(DATA), 1, 1))
    history = History(blank, blank[..., 0], jnp.zeros((len(DATA), 0), jnp.int32), jnp.zeros(len(DATA), bool))
    smoother = laplace_smoother(model, num_draws=num_draws, num_mode_steps=num_mode_steps)
    return smoother.smooth(jax.random.key(0), history, model.observe({"y": DATA}), None)


@pytest.mark.full
def test_the_mode_of_a_robust_model_is_found() -> None:
    """It is a general optimiser's, and the mean of n draws within 4 standard errors of it; after a step it is not found."""
    mode = minimize(energy, np.zeros(len(DATA)), tol=1e-10).x
    assert mode[2] < 1.0  # the outlier counts little
    for num_mode_steps, near in ((20, True), (1, False)):
        found = smoothed(1, num_mode_steps)
        assert np.allclose(found.marginals.means[:, 0, 0], mode, atol=1e-4) == near
    draws = np.asarray(smoothed(4000).particles[..., 0], np.float64)
    error = np.abs(draws.mean(1) - mode) / (draws.std(1) / np.sqrt(draws.shape[1]))
    assert error.max() < 4.0


@pytest.mark.full
def test_it_climbs_until_a_step_promises_nothing() -> None:
    taken = [float(smoothed(1, most).info.num_gradient) / len(DATA) for most in (100, 2)]
    assert 6 < taken[0] < 30  # three climbs
    assert 4 < taken[1] <= 8  # and a last step of two of them


@pytest.mark.full
def test_of_two_modes_it_finds_the_higher_from_the_other() -> None:
    """Squares of a walk are seen, which may have either sign; at the start it is more likely to be positive."""

    def initial(params: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(1.0, 1.0))

    def transition(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("x", dist.Normal(state["x"], 0.1))

    def observation(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("y", dist.Normal(state["x"] ** 2, 0.1))

    model, weights = StateSpaceModel(initial, transition, observation).compile(), jnp.zeros((10, 1))
    wrong = History(jnp.full((10, 1, 1), -1.0), weights, weights.astype(int), weights[:, 0] > 0)
    found = laplace_smoother(model, num_draws=1).smooth(jax.random.key(0), wrong, model.observe({"y": np.ones(10)}), None)
    assert np.abs(found.marginals.means - 1.0).max() < 0.05


def spread_at(squared: Any) -> Any:
    """Standard deviations where squared errors are these, in units of the noise's variance; no curvature is negative."""
    ratio = squared / STRENGTH
    weight = np.where(np.isfinite(DATA), np.maximum((1 - ratio) / (1 + ratio) ** 2, 0.0), 0.0) / NOISE**2
    beside = np.diag(np.full(len(DATA) - 1, STEP**-2), 1)
    precision = np.diag(weight + 2 / STEP**2) - beside - beside.T
    precision[0, 0] += 1.0 - 1 / STEP**2
    precision[-1, -1] -= 1 / STEP**2
    return np.sqrt(np.diag(np.linalg.inv(precision)))


def test_draws_have_the_spread_of_the_curvature_at_expected_errors() -> None:
    found = smoothed(4000)
    draws = np.asarray(found.particles[..., 0], np.float64)
    squared = np.square((DATA - draws.mean(1)) / NOISE)
    expected = spread_at(squared + np.square(spread_at(squared) / NOISE))
    assert np.abs(draws.std(1) / expected - 1).max() < 4 / np.sqrt(2 * 4000) + 0.01
    assert np.abs(np.sqrt(found.marginals.variances[:, 0, 0]) / expected - 1).max() < 0.01


@pytest.mark.full
@pytest.mark.parametrize("step", [0.3, 1.0])
def test_intervals_of_a_robust_model_hold(step: float) -> None:
    """The coverage of 90 % intervals for drawn trajectories is 88 to 92 %; by the curvature at the mode it is lower."""
    model, num_frames = robust_walk(step).compile(), 20
    blank = jnp.zeros((num_frames, 1, 1))
    history = History(blank, blank[..., 0], jnp.zeros((num_frames, 0), jnp.int32), jnp.zeros(num_frames, bool))
    smoother = laplace_smoother(model, num_draws=1)

    def inside(key: Any) -> Any:
        states, data = draw_sequence(model, jax.random.split(key, (num_frames, 2)), None)
        seen = Observation(data, {"y": jnp.ones(num_frames, bool)})
        found = smoother.smooth(key, history, seen, None).marginals
        return jnp.mean(jnp.abs(states[:, 0] - found.means[:, 0, 0]) < 1.645 * jnp.sqrt(found.variances[:, 0, 0]))

    held = np.asarray(jax.jit(jax.vmap(inside))(jax.random.split(jax.random.key(0), 1000)))
    error = held.std() / np.sqrt(len(held))
    assert abs(held.mean() - 0.9) < 0.02 + 3 * error


def test_settings_and_discrete_sites_are_refused() -> None:
    model = robust_walk().compile()
    for settings in ({"num_draws": 0}, {"num_mode_steps": 0}):
        with pytest.raises(ValueError, match="at least 1"):
            laplace_smoother(model, **settings)
    with pytest.raises(ValueError, match="is discrete"):
        laplace_smoother(finite_hmm().compile())


def test_what_hardly_changes_is_no_surer_than_its_data() -> None:
    """In double precision; a ridge as wide as float32 needs would be data of its own in each frame."""
    step, num_frames = 1e-4, 50
    with jax.enable_x64(True):
        inner = jnp.full((num_frames, 1, 1), 2 / step**2).at[jnp.array([0, -1])].set(1 / step**2).at[0].add(1.0)
        precision = BlockTridiagonal(inner, jnp.full((num_frames - 1, 1, 1), -1 / step**2))
        found = marginal_covariances(safe_cholesky(precision)).own[:, 0, 0]
        np.testing.assert_allclose(found, 1 + step**2 * np.arange(num_frames), rtol=1e-4)
        narrow = marginal_covariances(block_cholesky(precision, ridge=1e-6)).own[:, 0, 0]
        assert (narrow < 0.01).all()
