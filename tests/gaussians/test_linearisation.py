"""Conditionals linearised over points, against moments of polynomials that are known."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.gaussians.gaussian import Gaussian
from poseppl.gaussians.linearisation import linearise


def gaussian(dimension: int) -> tuple[np.ndarray, np.ndarray, Gaussian]:
    rng = np.random.default_rng(dimension)
    root, mean = rng.normal(size=(dimension, dimension)), rng.normal(size=dimension)
    covariance = root @ root.T + 0.2 * np.eye(dimension)
    return mean, covariance, Gaussian(jnp.asarray(mean), jnp.asarray(covariance))


@pytest.mark.parametrize(("method", "dimension"), [("unscented", 2), ("unscented", 5), ("gauss-hermite", 2)])
def test_a_quadratic_and_a_noise_that_changes_have_their_exact_moments(method: str, dimension: int) -> None:
    """E[x'x], Cov[x'x, x] and the mean of a noise of x_0^2; what a line leaves is never less than that noise."""
    mean, covariance, x = gaussian(dimension)
    found = linearise(lambda x: (jnp.sum(x**2, keepdims=True), x[:1, None] ** 2), x, method)
    np.testing.assert_allclose(found.mean, mean @ mean + np.trace(covariance), rtol=1e-4)
    np.testing.assert_allclose(found.jacobian[0], 2 * mean, rtol=1e-3, atol=1e-3)
    noise = mean[0] ** 2 + covariance[0, 0]
    assert float(found.noise[0, 0]) > noise * (1 - 1e-4) - 1e-3
    if method == "gauss-hermite":  # exact for a square of the quadratic, too
        np.testing.assert_allclose(found.noise[0, 0], noise + 2 * np.trace(covariance @ covariance), rtol=1e-4)
    linear = linearise(lambda x: (x[:1], x[:1, None] ** 2), x, method)
    np.testing.assert_allclose(linear.noise[0, 0], noise, rtol=1e-4)
