"""Small mixtures of Gaussians: density, curvature, draws and fit against SciPy and closed forms."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

from poseppl.gaussians.chain_mixture import _far_apart, fit_mixture
from poseppl.gaussians.mixture import GaussianMixture, draw_mixture, factorise_mixture, log_mixture, mixture_curvature

WEIGHTS = np.array([0.7, 0.3])
MEANS = np.array([[0.0, 1.0], [6.0, -2.0]])
COVARIANCES = np.array([[[1.0, 0.4], [0.4, 0.5]], [[0.2, 0.0], [0.0, 3.0]]])
MIXTURE = GaussianMixture(*(jnp.asarray(part, jnp.float32) for part in (np.log(WEIGHTS), MEANS, COVARIANCES)))


@pytest.mark.full
def test_density():
    points = np.random.default_rng(0).normal(2.0, 2.0, (20, 2))
    parts = [scipy.stats.multivariate_normal(m, c).pdf(points) for m, c in zip(MEANS, COVARIANCES, strict=True)]
    found = jax.vmap(log_mixture(MIXTURE))(jnp.asarray(points))
    np.testing.assert_allclose(found, np.log(WEIGHTS @ np.array(parts)), rtol=1e-5, atol=1e-4)


def test_curvature_at_a_component_is_its_precision():
    """Far from the others its responsibility is 1; between them each counts by its own."""
    curvature = mixture_curvature(MIXTURE)
    for mean, covariance in zip(MEANS, COVARIANCES, strict=True):
        np.testing.assert_allclose(curvature(jnp.asarray(mean)), np.linalg.inv(covariance), rtol=1e-3, atol=1e-3)
    middle = np.array([3.6, -0.5])
    parts = [scipy.stats.multivariate_normal(m, c).pdf(middle) for m, c in zip(MEANS, COVARIANCES, strict=True)]
    share = WEIGHTS * parts / (WEIGHTS @ parts)
    expected = np.tensordot(share, np.linalg.inv(COVARIANCES), 1)
    np.testing.assert_allclose(curvature(jnp.asarray(middle)), expected, rtol=1e-3, atol=1e-4)


def test_covariances_of_few_draws_have_heavy_tails():
    """Up to a factor SciPy's multivariate t of n - d degrees of freedom; the curvature is that of a component at its mean."""
    points, number, dimension = np.random.default_rng(1).normal(2.0, 2.0, (20, 2)), 12.0, 2
    one = jax.tree.map(lambda part: part[:1], MIXTURE)._replace(log_weights=jnp.zeros(1))
    shape = COVARIANCES[0] * (number - 1) / (number - dimension)
    expected = scipy.stats.multivariate_t(MEANS[0], shape, number - dimension).logpdf(points)
    factors = factorise_mixture(one, jnp.float32(number))
    density = log_mixture(one, factors)
    offset = np.asarray(jax.vmap(density)(jnp.asarray(points, jnp.float32))) - expected
    np.testing.assert_allclose(offset, offset.mean(), atol=1e-4)
    mean = jnp.asarray(MEANS[0], jnp.float32)
    curvature = mixture_curvature(one, factors)(mean)
    np.testing.assert_allclose(curvature, -jax.hessian(density)(mean), rtol=1e-4)
    laplace = density(mean) + np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(curvature)[1]
    assert abs(laplace) < 1e-5
    wide = log_mixture(MIXTURE, factorise_mixture(MIXTURE, jnp.float32(1e6)))
    np.testing.assert_allclose(
        jax.vmap(wide)(jnp.asarray(points)), jax.vmap(log_mixture(MIXTURE))(jnp.asarray(points)), atol=2e-3
    )


@pytest.mark.full
def test_draws_come_from_their_components():
    draws, component = (np.asarray(part) for part in draw_mixture(jax.random.key(0), MIXTURE, 20_000))
    assert abs((component == 1).mean() - 0.3) < 5 * np.sqrt(0.21 / 20_000)
    for k in (0, 1):
        own = draws[component == k]
        error = np.sqrt(np.diagonal(COVARIANCES[k]) / len(own))
        assert (np.abs(own.mean(0) - MEANS[k]) < 5 * error).all()
        np.testing.assert_allclose(np.cov(own.T), COVARIANCES[k], atol=5 * 3 * np.sqrt(2 / len(own)))


def test_fit_finds_the_mixture():
    """40 chains of 100 draws, each of one component."""
    rng = np.random.default_rng(1)
    component = (np.arange(40) < 12).astype(int)
    chains = np.stack([rng.multivariate_normal(MEANS[k], COVARIANCES[k], 100) for k in component])
    mixture, residuals = fit_mixture(jnp.asarray(chains, jnp.float32), 2)
    order = np.argsort(np.asarray(mixture.means)[:, 0])
    np.testing.assert_allclose(np.exp(mixture.log_weights)[order], WEIGHTS, atol=1e-3)
    np.testing.assert_allclose(np.asarray(mixture.means)[order], MEANS, atol=5 * np.sqrt(3 / 1200))
    # each covariance is shrunk by one pseudo-draw a dimension, among thousands
    np.testing.assert_allclose(np.asarray(mixture.covariances)[order], COVARIANCES, atol=5 * 3 * np.sqrt(2 / 1200))
    np.testing.assert_allclose(residuals, chains - MEANS[component][:, None], atol=0.3)


@pytest.mark.full
def test_chains_count_by_their_weights():
    """A chain of the weight of two is the same as the chain twice, but for what the number of draws is worth."""
    rng = np.random.default_rng(2)
    chains = jnp.asarray([rng.multivariate_normal(MEANS[k], COVARIANCES[k], 400) for k in (0, 0, 1)], jnp.float32)
    weighted, _ = fit_mixture(chains, 2, jnp.log(jnp.array([1.0, 1.0, 2.0])))
    twice, _ = fit_mixture(chains[jnp.array([0, 1, 2, 2])], 2)
    plain, _ = fit_mixture(chains, 2)
    by_mean = [np.argsort(np.asarray(found.means)[:, 0]) for found in (weighted, twice, plain)]
    shares = [np.exp(found.log_weights)[order] for found, order in zip((weighted, twice, plain), by_mean, strict=True)]
    np.testing.assert_allclose(shares[0], shares[1], atol=1e-3)
    assert np.abs(shares[0] - shares[2]).max() > 0.1
    np.testing.assert_allclose(weighted.means[by_mean[0]], twice.means[by_mean[1]], atol=5e-3)
    one, _ = fit_mixture(chains, 1, jnp.log(jnp.array([1.0, 1.0, 2.0])))
    again, _ = fit_mixture(chains[jnp.array([0, 1, 2, 2])], 1)
    np.testing.assert_allclose(one.means, again.means, rtol=1e-4)
    np.testing.assert_allclose(one.covariances, again.covariances, rtol=2e-3)


@pytest.mark.full
@pytest.mark.parametrize("number", [2, 8])
def test_few_draws_in_many_dimensions_leave_no_direction_without_variance(number):
    """Draws that all lie in a plane of ten dimensions, in units as far apart as millimetres and radians."""
    rng = np.random.default_rng(3)
    plane = rng.normal(size=(2, 10)) * 10.0 ** rng.uniform(-3, 2, 10)
    chains = jnp.asarray(rng.normal(size=(4, number, 2)) @ plane, jnp.float32)
    mixture, residuals = fit_mixture(chains, 3)
    assert all(np.isfinite(leaf).all() for leaf in (*mixture, residuals))
    assert np.isfinite(jax.vmap(log_mixture(mixture))(chains.reshape(-1, 10))).all()


def test_a_coordinate_that_is_the_same_in_all_draws_has_no_variance():
    draws = np.random.default_rng(4).normal(size=(6, 50, 3)) * [1.0, 0.0, 1e-3]
    mixture, residuals = fit_mixture(jnp.asarray(draws, jnp.float32), 3)
    assert all(np.isfinite(leaf).all() for leaf in (*mixture, residuals))
    assert np.asarray(mixture.covariances)[:, 1, 1].max() < 1e-15
    np.testing.assert_allclose(mixture.means[:, 1], 0.0)


def test_one_component_is_the_mean_and_covariance_of_the_draws():
    draws = np.random.default_rng(5).normal(size=(3, 4, 2))
    (_, means, covariances), residuals = fit_mixture(jnp.asarray(draws), 1)
    flat = draws.reshape(-1, 2)
    np.testing.assert_allclose(means[0], flat.mean(0), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(covariances[0], np.cov(flat.T), rtol=1e-4)
    np.testing.assert_allclose(residuals, draws - flat.mean(0), atol=1e-6)


def test_components_start_far_from_all_that_came_before():
    """By hand: the outermost point, the one at the other end, and then one that is far from both; in white units."""
    places = jnp.array([[0.0, 0.0], [10.0, 0.0], [9.0, 0.0], [5.0, 0.03], [4.0, 0.0]])
    assert sorted(np.asarray(_far_apart(places, jnp.diag(jnp.array([1.0, 1e-4])), 3))) == [0, 1, 3]
