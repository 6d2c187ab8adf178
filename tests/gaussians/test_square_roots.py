"""Gaussians by the root of their covariance: the same as by the covariance, and right where float32 rounds that."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.gaussians.gaussian import Gaussian, RootGaussian, semidefinite_root, triangular
from poseppl.gaussians.linearisation import Linear, condition, predict

MEAN = np.array([0.5, -1.0, 2.0])
ROOT = np.array([[1.0, 0.0, 0.0], [0.4, 0.8, 0.0], [-0.3, 0.2, 1.5]])
JACOBIAN = np.array([[1.0, 0.2, 0.0], [0.0, 1.0, -1.0]])
NOISE = np.array([[0.5, 0.1], [0.1, 0.3]])
Y, SEEN = np.array([0.7, -2.0]), np.array([True, True])


def forms():
    return Gaussian(jnp.asarray(MEAN), jnp.asarray(ROOT @ ROOT.T)), RootGaussian(jnp.asarray(MEAN), jnp.asarray(ROOT))


@pytest.mark.parametrize("seen", [[True, True], [False, True], [False, False]])
def test_both_forms_condition_as_the_formula_does(seen):
    kept = np.flatnonzero(seen)
    covariance, rows, noise = ROOT @ ROOT.T, JACOBIAN[kept], NOISE[np.ix_(kept, kept)]
    of_data = rows @ covariance @ rows.T + noise
    gain = np.linalg.solve(of_data, rows @ covariance).T
    residual = Y[kept] - JACOBIAN[kept] @ MEAN
    evidence = -0.5 * (residual @ np.linalg.solve(of_data, residual) + np.linalg.slogdet(2 * np.pi * of_data)[1])
    linear = Linear(jnp.asarray(JACOBIAN @ MEAN), jnp.asarray(JACOBIAN), jnp.asarray(NOISE))
    for form in forms():
        posterior, found = condition(form, linear, jnp.asarray(Y), jnp.asarray(seen))
        np.testing.assert_allclose(posterior.mean, MEAN + gain @ residual, rtol=2e-5)
        np.testing.assert_allclose(posterior.covariance, covariance - gain @ of_data @ gain.T, atol=3e-6)
        np.testing.assert_allclose(found, evidence, rtol=1e-5, atol=1e-6)


def test_both_forms_predict_as_the_formula_does():
    linear = Linear(jnp.asarray(JACOBIAN @ MEAN), jnp.asarray(JACOBIAN), jnp.asarray(NOISE))
    for form in forms():
        found = predict(form, linear)
        np.testing.assert_allclose(found.covariance, JACOBIAN @ ROOT @ ROOT.T @ JACOBIAN.T + NOISE, rtol=1e-5)


def test_a_triangular_root_has_the_product_and_a_diagonal_that_is_not_negative():
    wide = np.random.default_rng(0).normal(size=(3, 5))
    lower = np.asarray(triangular(jnp.asarray(wide)))
    np.testing.assert_allclose(lower @ lower.T, wide @ wide.T, rtol=1e-4, atol=1e-5)
    assert np.all(np.triu(lower, 1) == 0) and np.all(np.diagonal(lower) >= 0)


@pytest.mark.parametrize(
    "covariance",
    [
        np.diag([4.0, 0.0, 1e-6]),
        np.zeros((2, 2)),
        np.outer([1.0, -2.0, 0.5], [1.0, -2.0, 0.5]),
        np.outer([1e4, 1.0], [1e4, 1.0]) + np.diag([0.0, 1e-7]),
        NOISE,
    ],
)
def test_the_root_of_a_covariance_that_may_be_singular(covariance):
    lower = np.asarray(semidefinite_root(jnp.asarray(covariance)))
    scale = np.sqrt(np.outer(np.diagonal(covariance), np.diagonal(covariance))) + 1e-30
    np.testing.assert_allclose(lower @ lower.T / scale, covariance / scale, atol=1e-5)
    assert np.isfinite(jax.jacrev(semidefinite_root)(jnp.asarray(NOISE))).all()


@pytest.mark.parametrize("covariance", [np.diag([1.0, np.nan]), np.diag([1.0, -1.0])])
def test_the_root_of_what_is_no_covariance(covariance):
    assert not np.isfinite(semidefinite_root(jnp.asarray(covariance))).all()
