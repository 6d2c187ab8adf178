from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.particles.weights import effective_sample_size, normalise, weigh, weighted_covariance, weighted_mean


def reference(log_weights):
    weights = np.exp(np.asarray(log_weights, float))
    return weights / weights.sum()


def test_against_plain_formulae():
    log_weights = jax.random.normal(jax.random.key(0), (50,))
    particles = jax.random.normal(jax.random.key(1), (50, 3))
    w = reference(log_weights)
    found = normalise(log_weights)
    np.testing.assert_allclose(found.weights, w, rtol=1e-5)
    np.testing.assert_allclose(np.exp(found.log_weights), w, rtol=1e-5)
    np.testing.assert_allclose(found.log_mean, np.log(np.exp(np.asarray(log_weights, float)).mean()), rtol=1e-5)
    np.testing.assert_allclose(effective_sample_size(log_weights), 1 / (w**2).sum(), rtol=1e-5)
    np.testing.assert_allclose(weighted_mean(particles, log_weights), w @ particles, rtol=1e-4, atol=1e-6)
    expected = np.cov(np.asarray(particles), rowvar=False, aweights=w, ddof=0)
    np.testing.assert_allclose(weighted_covariance(particles, log_weights), expected, rtol=1e-4, atol=1e-6)
    assert not found.degenerate


@pytest.mark.parametrize("shift", [-1e4, -300.0, 0.0, 300.0, 1e4])
def test_only_ratios_matter(shift):
    log_weights = jnp.log(jnp.array([0.1, 0.2, 0.7]))
    found = normalise(log_weights + shift)
    np.testing.assert_allclose(found.weights, [0.1, 0.2, 0.7], rtol=2e-3)  # 1e4 leaves 1e-3 of absolute precision
    np.testing.assert_allclose(found.log_mean, np.log(1 / 3) + shift, rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("bad", [[-jnp.inf, -jnp.inf], [jnp.nan, jnp.nan], [jnp.nan, -jnp.inf], [jnp.inf, 0.0]])
def test_degenerate_sets_are_flagged_and_uniform(bad):
    found = normalise(jnp.array(bad))
    assert found.degenerate
    assert found.log_mean == -np.inf
    assert found.ess == 0
    np.testing.assert_allclose(found.weights, 0.5)
    np.testing.assert_allclose(found.log_weights, np.log(0.5))


def test_nan_counts_as_no_weight():
    found = normalise(jnp.array([jnp.nan, 0.0, 0.0, -jnp.inf]))
    np.testing.assert_allclose(found.weights, [0, 0.5, 0.5, 0])
    np.testing.assert_allclose(found.log_mean, np.log(0.5), rtol=1e-6)
    assert found.ess == 2
    assert not found.degenerate


def test_particles_without_weight_are_not_read():
    particles = jnp.array([[1.0], [3.0], [jnp.nan], [jnp.inf]])
    log_weights = jnp.array([0.0, 0.0, -jnp.inf, jnp.nan])
    assert weighted_mean(particles, log_weights) == 2.0
    assert weighted_covariance(particles, log_weights) == 1.0


@pytest.mark.full
def test_gradients_are_finite_with_weights_of_zero():
    gradient = jax.grad(lambda w: normalise(w).log_mean)(jnp.array([0.0, -jnp.inf, -1.0]))
    assert np.isfinite(gradient).all()


def test_particles_are_weighed_by_their_likelihoods():
    prior, likelihood = np.array([0.5, 0.3, 0.2]), np.array([0.1, 0.4, 0.0])
    weighed = weigh(jnp.log(prior), jnp.log(likelihood))
    np.testing.assert_allclose(np.exp(weighed.log_weights), prior * likelihood / (prior @ likelihood), rtol=1e-5)
    np.testing.assert_allclose(np.exp(weighed.log_evidence), prior @ likelihood, rtol=1e-5)
    assert not weighed.failed


@pytest.mark.full
@pytest.mark.parametrize("impossible", [-jnp.inf, jnp.nan])
def test_impossible_data_leave_the_weights_before_them(impossible):
    prior = np.array([0.5, 0.3, 0.2])
    weighed = weigh(jnp.log(2 * prior), jnp.full(3, impossible))
    np.testing.assert_allclose(np.exp(weighed.log_weights), prior, rtol=1e-5)
    np.testing.assert_allclose(weighed.ess, 1 / (prior**2).sum(), rtol=1e-5)
    assert weighed.log_evidence == -jnp.inf
    assert weighed.failed
