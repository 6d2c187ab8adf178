"""Laplace's approximation with coordinates that keep their prior, against the dense Gaussian of a linear model."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.compilation import double_precision
from poseppl.program import Lorentzian, StateSpaceModel
from poseppl.smoothers.base import History
from poseppl.smoothers.laplace import cut_laplace_smoother, laplace_smoother

FRAMES, STEP, NOISE, WIDE = 6, 0.7, 0.5, 2.0


def initial(params: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.5))
    numpyro.sample("c", dist.Normal(jnp.array([1.0, -1.0]), WIDE))


def transition(params: Any, state: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(0.9 * state["x"], STEP))
    numpyro.sample("c", dist.Normal(state["c"], 1e-3))


def observation(params: Any, state: Any, inputs: Any) -> None:
    seen = jnp.array([state["x"][0] + state["c"][0], state["x"][1] - state["c"][0] + 0.5 * state["c"][1], state["c"][1]])
    numpyro.sample("z", dist.Normal(seen, NOISE))


def dense() -> tuple[Any, Any, Any]:
    """Precision (14, 14) of x_0, ..., x_5 and c, its vector's matrix (14, 18) of the data, and the prior's vector (14,)."""
    size = 2 * FRAMES
    precision, data, vector = np.zeros((size + 2, size + 2)), np.zeros((size + 2, 3 * FRAMES)), np.zeros(size + 2)
    precision[:2, :2] += np.eye(2) / 1.5**2
    precision[size:, size:] += np.eye(2) / WIDE**2
    vector[size:] = np.array([1.0, -1.0]) / WIDE**2
    for t in range(FRAMES):
        rows = np.zeros((3, size + 2))
        rows[0, 2 * t], rows[1, 2 * t + 1] = 1, 1
        rows[:, size:] = [[1, 0], [-1, 0.5], [0, 1]]
        precision += rows.T @ rows / NOISE**2
        data[:, 3 * t : 3 * t + 3] = rows.T / NOISE**2
        if t:
            step = np.zeros((2, size + 2))
            step[:, 2 * t : 2 * t + 2], step[:, 2 * t - 2 : 2 * t] = np.eye(2), -0.9 * np.eye(2)
            precision += step.T @ step / STEP**2
    return precision, data, vector


@pytest.fixture(scope="module")
def smoothed() -> tuple[Any, Any]:
    """The model to smooth, in double precision, and the data."""
    values = np.random.default_rng(0).normal(size=(FRAMES, 3))
    with double_precision():
        model = StateSpaceModel(initial, transition, observation).compile()
        states = jnp.ones((FRAMES, 1, 4))
        history = History(states, jnp.zeros((FRAMES, 1)), jnp.zeros((FRAMES, 1), int), jnp.zeros(FRAMES, bool))
        smoother = cut_laplace_smoother(model, 2, num_draws=4000, num_mode_steps=2)
        found = jax.jit(smoother.smooth)(jax.random.key(0), history, model.observe({"z": values}))
    return jax.tree.map(np.asarray, found), values


def test_what_does_not_change_keeps_its_prior_and_the_rest_follows(smoothed: tuple[Any, Any]) -> None:
    """Means and covariances of 4000 draws are those of p(c) p(x | c, z), within 5 standard errors."""
    precision, data, vector = dense()
    draws, size = smoothed[0].particles, 2 * FRAMES
    assert np.array_equal(draws[0, :, 2:], draws[-1, :, 2:])
    covariance = np.linalg.inv(precision[:size, :size])
    response = -covariance @ precision[:size, size:]
    prior = WIDE**2 * np.eye(2)
    static = np.array([1.0, -1.0])
    moving = covariance @ (data @ smoothed[1].ravel() + vector)[:size] + response @ static
    mean = np.concatenate([moving, static])
    whole = np.block([[covariance + response @ prior @ response.T, response @ prior], [prior @ response.T, prior]])
    own = np.concatenate([np.diag(whole)[:size].reshape(FRAMES, 2), np.full((FRAMES, 2), WIDE**2)], 1)
    np.testing.assert_allclose(smoothed[0].marginals.variances.reshape(FRAMES, 4), own, rtol=1e-4)
    np.testing.assert_allclose(smoothed[0].marginals.means.reshape(FRAMES, 4)[:, :2].ravel(), moving, rtol=1e-3, atol=1e-4)
    flat = np.concatenate([np.moveaxis(draws[:, :, :2], 1, 0).reshape(-1, size), draws[0, :, 2:]], 1)
    deviation, count = np.sqrt(np.diag(whole)), len(flat)
    assert np.all(np.abs(flat.mean(0) - mean) < 5 * deviation / np.sqrt(count))
    error = np.sqrt((np.outer(deviation, deviation) ** 2 + whole**2) / count)
    assert np.all(np.abs(np.cov(flat.T) - whole) < 5 * error)


@pytest.mark.full
def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="num_static"):
        cut_laplace_smoother(StateSpaceModel(initial, transition, observation).compile(), 0)


@pytest.mark.full
def test_robust_sites_are_as_sure_as_in_laplace_s_approximation() -> None:
    """If data do not depend on static coordinates, the rest agrees with Laplace's smoother, to the precision of searches."""

    def robust(params: Any, state: Any, inputs: Any) -> None:
        numpyro.sample("z", Lorentzian(dist.Normal(state["x"], NOISE), 4.0))

    model = StateSpaceModel(initial, transition, robust).compile()
    values = np.random.default_rng(1).normal(size=(FRAMES, 2)) * np.where(np.arange(FRAMES) == 2, 5.0, 1.0)[:, None]
    blank = jnp.zeros((FRAMES, 1))
    history = History(jnp.ones((FRAMES, 1, 4)), blank, blank.astype(int), blank[:, 0] > 0)
    cut, whole = (
        smoother.smooth(jax.random.key(0), history, model.observe({"z": values})).marginals
        for smoother in (cut_laplace_smoother(model, 2, num_draws=2), laplace_smoother(model, num_draws=2))
    )
    for ours, theirs in ((cut.means, whole.means), (cut.variances, whole.variances)):
        parts = (np.asarray(each).reshape(FRAMES, 4)[:, :2] for each in (ours, theirs))
        np.testing.assert_allclose(*parts, rtol=0.03, atol=0.03)
