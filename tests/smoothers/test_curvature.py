"""The curvature of trajectories of a linear Gaussian model, and draws by it, against its Hessian and Rauch-Tung-Striebel."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from oracles.kalman import kalman_filter, rauch_tung_striebel
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model

from poseppl.gaussians.block_tridiagonal import to_dense
from poseppl.smoothers.curvature import average_precision, draws_about

MATRICES = linear_gaussian_matrices(2, 1, A=[[0.9, 0.5], [-0.3, 0.7]], Q=[[0.3, 0.1], [0.1, 0.2]])
MODEL = linear_gaussian_model(MATRICES).compile()
YS = np.random.default_rng(0).normal(size=(3, 1))
DATA = MODEL.observe({"y": YS})


def test_the_mean_curvature_is_that_of_each_trajectory():
    """Minus the Hessian, whatever the trajectories."""
    trajectories = jax.random.normal(jax.random.key(0), (4, 3, 2))
    found = to_dense(jax.jit(lambda xs: average_precision(MODEL, xs, DATA, None))(trajectories))
    exact = -jax.jit(jax.hessian(lambda flat: MODEL.log_joint(flat.reshape(3, 2), DATA, None)))(trajectories[0].ravel())
    np.testing.assert_allclose(found, exact, rtol=1e-3, atol=1e-3)


def test_draws_about_the_mode_are_of_the_smoothing_distribution():
    means, covariances = rauch_tung_striebel(MATRICES, kalman_filter(MATRICES, YS))
    number = 20_000
    draw = jax.jit(lambda key: draws_about(MODEL, number, key, jnp.asarray(means), DATA, None, lambda xs: xs))
    draws = np.asarray(draw(jax.random.key(1)), float)
    spread = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert (np.abs(draws.mean(0) - means) < 5 * spread / np.sqrt(number)).all()
    for t in range(3):
        limit = 5 * np.outer(spread[t], spread[t]) * np.sqrt(2 / number)
        assert (np.abs(np.cov(draws[:, t].T) - covariances[t]) < limit).all()
