"""Expectation maximisation of weighted points: a round by the published formulas, and the least variance of a component."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from poseppl.gaussians.weighted_em import choose_seeds, fit_fixed, fit_free


@pytest.mark.parametrize("free", [False, True])
def test_a_round_is_that_of_the_formulas(free: bool) -> None:
    """Eqs. 18 to 21 of Peursum et al. in plain loops, from components at seeds that count by their weights; one is empty."""
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(40, 2)), rng.dirichlet(np.ones(40))
    seeds, alive, scales = np.array([3, 17, 5]), np.array([True, True, False]), np.array([0.5, 0.8])
    common = np.cov(points.T, aweights=weights, ddof=0) + 0.01 * np.eye(2)
    covariance = common if free else np.diag(scales**2)
    eta = weights[seeds[:2]] / weights[seeds[:2]].sum()
    parts = np.stack([multivariate_normal(points[s], covariance).pdf(points) for s in seeds[:2]], 1) * eta
    share = weights[:, None] * parts / parts.sum(1, keepdims=True)
    mass = share.sum(0)
    means = share.T @ points / mass[:, None]
    arrays = map(jnp.asarray, (points, weights, seeds, alive))
    if free:
        found = fit_free(*arrays, 1, jnp.full(2, 0.01))
        shrink = 2 * np.square(weights).sum()
        for k in range(2):
            apart = points - means[k]
            own = (share[:, k, None] * apart).T @ apart + 0.01 * mass[k] * np.eye(2)
            np.testing.assert_allclose(found.covariances[k], (own + shrink * common) / (mass[k] + shrink), rtol=1e-3)
    else:
        found = fit_fixed(*arrays, jnp.asarray(scales), 1)
        np.testing.assert_allclose(found.covariances[0], covariance, rtol=1e-5)
    np.testing.assert_allclose(np.exp(found.log_weights), [*mass, 0.0], rtol=1e-3)
    np.testing.assert_allclose(found.means[:2], means, rtol=1e-3, atol=1e-4)


def test_seeds_are_points_of_at_least_the_average_weight() -> None:
    weights = np.array([0.3, 0.1, 0.25, 0.05, 0.25, 0.05])
    chosen, alive = choose_seeds(jnp.zeros(2, jnp.uint32), jnp.log(weights), 5)
    assert sorted(np.asarray(chosen)[np.asarray(alive)]) == [0, 2, 4] and chosen.shape == (5,)
    few, there = choose_seeds(jnp.ones(2, jnp.uint32), jnp.log(weights), 2)
    assert set(np.asarray(few)) < {0, 2, 4} and there.all()
