"""A detector's errors with clutter: the density against its parts, its integral, its draws and its derivatives."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from scipy.integrate import dblquad
from scipy.stats import multivariate_t, t

from poseppl.compilation import double_precision
from poseppl.program import Cluttered

FREEDOM, ODDS, SIDES = 5.0, -1.5, (40.0, 30.0)
SHARE = 1 / (1 + np.exp(-ODDS))


@pytest.fixture(autouse=True)
def _double_precision() -> Iterator[None]:
    with double_precision():
        yield


@pytest.fixture
def errors(_double_precision: None) -> Cluttered:
    """Points around (18, 13) in a small picture."""
    gaussian = dist.Normal(jnp.array([18.0, 13.0]), jnp.array(1.5)).to_event(1)
    return Cluttered(gaussian, FREEDOM, ODDS, jnp.array(SIDES))


def expected(points: np.ndarray) -> np.ndarray:
    peak = multivariate_t(np.array([18.0, 13.0]), 1.5**2 * np.eye(2), FREEDOM).pdf(points)
    return np.log((1 - SHARE) * peak + SHARE / np.prod(SIDES))


def test_the_density_is_that_of_the_mixture(errors: Cluttered) -> None:
    points = np.array([[18.0, 13.0], [19.0, 11.0], [25.0, 20.0], [1.0, 29.0]])
    assert np.allclose(errors.log_prob(jnp.asarray(points)), expected(points), rtol=1e-10)
    probability = SHARE / np.prod(SIDES) / np.exp(expected(points))
    assert np.allclose(errors.clutter_probability(jnp.asarray(points)), probability, rtol=1e-10)


@pytest.mark.full
def test_numbers_by_themselves(errors: Cluttered) -> None:
    single = Cluttered(dist.Normal(jnp.array([3.0, 20.0]), 2.0), FREEDOM, ODDS, 50.0)
    peak = t(FREEDOM, np.array([3.0, 20.0]), 2.0).pdf(22.0)
    assert np.allclose(single.log_prob(jnp.array(22.0)), np.log((1 - SHARE) * peak + SHARE / 50), rtol=1e-10)
    assert single.sample(jax.random.key(0), (3,)).shape == (3, 2)


@pytest.mark.full
def test_draws_have_the_density(errors: Cluttered) -> None:
    draws = np.asarray(errors.sample(jax.random.key(1), (40_000,)))
    inside = np.abs(draws - [18.0, 13.0]).max(-1) < 3.0
    share = dblquad(lambda y, x: float(np.exp(expected(np.array([x, y])))), 15, 21, 10, 16, epsabs=1e-6)[0]
    assert abs(inside.mean() - share) < 5 * np.sqrt(share * (1 - share) / len(draws))


def test_derivatives_of_the_potential(errors: Cluttered) -> None:
    squared = jnp.geomspace(1e-3, 1e4, 40)
    first, second = errors.derivatives(squared)
    assert np.allclose(first, jax.vmap(jax.grad(errors.potential))(squared), rtol=1e-8, atol=1e-12)
    assert np.allclose(second, jax.vmap(jax.grad(lambda s: errors.derivatives(s)[0]))(squared), rtol=1e-8, atol=1e-12)
