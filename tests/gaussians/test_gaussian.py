"""The inverse of a triangular matrix, whole or a few columns at a time; factors and densities of a Gaussian."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from poseppl.gaussians.gaussian import factorise, lower_inverse, precision_of, triangular_factors


@pytest.mark.full
@pytest.mark.parametrize("size", [1, 32, 33, 70])
def test_triangular_matrices_are_inverted(size):
    draws = np.random.default_rng(size).standard_normal((4 * size, size))
    lower = np.linalg.cholesky(draws.T @ draws)
    with jax.enable_x64(True):
        inverse = np.asarray(lower_inverse(jnp.asarray(lower)))
        stacked = jax.vmap(lower_inverse)(jnp.stack([jnp.asarray(lower), 2 * jnp.asarray(lower)]))
    np.testing.assert_allclose(inverse @ lower, np.eye(size), atol=1e-12)
    np.testing.assert_allclose(stacked[1], inverse / 2, rtol=1e-12)


def test_factors_of_covariances_whose_units_are_far_apart():
    """Root, inverse root, precision and log-density, against NumPy and SciPy in double precision."""
    rng = np.random.default_rng(1)
    draws = rng.normal(size=(20, 4)) @ rng.normal(size=(4, 4))
    covariance = np.cov(draws.T) * np.outer(scales := np.array([1e-3, 1.0, 50.0, 1e3]), scales)
    lower, root = (np.asarray(each, float) for each in triangular_factors(jnp.asarray(covariance, jnp.float32)))
    np.testing.assert_allclose(lower / scales[:, None], np.linalg.cholesky(covariance) / scales[:, None], atol=1e-4)
    white = scales[:, None] * np.linalg.inv(covariance) * scales
    np.testing.assert_allclose(scales[:, None] * (root.T @ root) * scales, white, rtol=1e-3, atol=1e-3 * np.abs(white).max())
    assert np.abs(np.triu(root, 1)).max() == 0
    precision = np.asarray(precision_of(jnp.asarray(covariance, jnp.float32)), float)
    np.testing.assert_allclose(scales[:, None] * precision * scales, white, rtol=1e-3, atol=1e-3 * np.abs(white).max())


def test_densities_of_states_and_of_draws():
    rng = np.random.default_rng(2)
    root, mean = rng.normal(size=(3, 3)), rng.normal(size=3)
    exact = multivariate_normal(mean, root @ root.T + 0.3 * np.eye(3))
    found = factorise(jnp.asarray(mean), jnp.asarray(exact.cov))
    states = rng.normal(size=(10, 3))
    np.testing.assert_allclose(found.log_density(jnp.asarray(states)), exact.logpdf(states), rtol=1e-3)
    draws, log_density = found.draw(jax.random.key(0), 20_000)
    np.testing.assert_allclose(log_density, exact.logpdf(draws), atol=1e-2)
    spread = np.sqrt(np.diag(exact.cov))
    assert (np.abs(np.asarray(draws).mean(0) - mean) < 5 * spread / np.sqrt(20_000)).all()
    assert (np.abs(np.cov(np.asarray(draws).T) - exact.cov) < 5 * np.outer(spread, spread) * np.sqrt(2 / 20_000)).all()
