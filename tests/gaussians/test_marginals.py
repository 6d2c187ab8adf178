"""Means, standard deviations and quantiles of mixtures of Gaussians."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
import scipy.stats

from poseppl.gaussians.gaussian import Gaussian
from poseppl.gaussians.marginals import Marginals, gaussian_marginals

LEVELS = np.array([0.05, 0.5, 0.95])
WEIGHTS = np.array([0.2, 0.5, 0.3])


def test_a_mixture_in_two_coordinates():
    """Moments by their formulae, quantiles by a root of the distribution function."""
    rng = np.random.default_rng(0)
    means, deviations = 2 * rng.normal(size=(3, 2)), rng.uniform(0.2, 1.0, (3, 2))
    # one more of no weight, which holds anything
    weights, broken = np.append(WEIGHTS, 0.0), np.full((1, 2), np.nan)
    found = Marginals(jnp.log(weights), jnp.concatenate([means, broken]), jnp.concatenate([deviations**2, broken]))
    mean = WEIGHTS @ means
    np.testing.assert_allclose(found.mean, mean, atol=1e-6)
    np.testing.assert_allclose(found.standard_deviation**2, WEIGHTS @ (deviations**2 + means**2) - mean**2, rtol=1e-5)
    for column, ends in enumerate(np.asarray(found.quantiles(jnp.asarray(LEVELS))).T):
        laws = scipy.stats.norm(means[:, column], deviations[:, column])
        roots = [scipy.optimize.brentq(lambda x, p=p: WEIGHTS @ laws.cdf(x) - p, -20, 20) for p in LEVELS]  # noqa: B023
        np.testing.assert_allclose(ends, roots, atol=1e-5)


@pytest.mark.full
def test_finite_values_are_their_own_quantiles():
    found = Marginals(jnp.log(WEIGHTS), jnp.arange(3.0)[:, None], jnp.zeros((3, 1)))
    np.testing.assert_array_equal(found.quantiles(jnp.array([0.1, 0.3, 0.65, 0.75])).ravel(), [0.0, 1.0, 1.0, 2.0])
    np.testing.assert_allclose(found.standard_deviation, np.sqrt(1.7 - 1.1**2), rtol=1e-6)


@pytest.mark.full
def test_one_gaussian():
    found = gaussian_marginals(*Gaussian(jnp.array([1.0, 2.0]), jnp.array([[4.0, 1.0], [1.0, 0.0]])))
    ends = np.stack([1 + 2 * scipy.stats.norm.ppf(LEVELS), np.full(3, 2.0)], 1)
    np.testing.assert_allclose(found.quantiles(jnp.asarray(LEVELS)), ends, rtol=1e-6)
