"""Iterated and quadrature Kalman filters and smoothers: nothing changes on a linear model, and a bent one is met better."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from law_problems import problem, run
from oracles.grid import grid_filter_smoother
from oracles.kalman import rauch_tung_striebel

from poseppl.errors import UnsuitableModelError
from poseppl.filters import kalman_filter
from poseppl.gaussians.gaussian import Gaussian
from poseppl.gaussians.linearisation import linearise, predict
from poseppl.program import StateSpaceModel
from poseppl.smoothers import smoothed_moments

YS = np.array([4.0, np.nan, 1.5, 0.3, 2.5, 6.0])
STEP, NOISE = 0.5, 0.2
every_method = pytest.mark.parametrize("method", ["first-order", "unscented", "gauss-hermite"])


def filtered(model, observations, inputs, method, num_iterations):
    built = kalman_filter(model, 1, linearisation=method, num_iterations=num_iterations)
    states, infos = jax.jit(lambda data, inputs: run(built, jax.random.key(0), data, inputs))(observations, inputs)
    return states.posterior, infos.log_evidence


@pytest.mark.parametrize(
    "method", ["first-order", *(pytest.param(each, marks=pytest.mark.full) for each in ("unscented", "gauss-hermite"))]
)
def test_iterations_change_nothing_on_a_linear_model(method):
    """Nor does quadrature: mean, covariance and evidence stay Kalman's, however often a frame is taken in."""
    posed = problem()
    posterior, log_evidence = filtered(posed.model, posed.observations, posed.inputs, method, 4)
    np.testing.assert_allclose(posterior.mean, posed.exact.means, atol=1e-5)
    np.testing.assert_allclose(posterior.covariance, posed.exact.covariances, atol=1e-5)
    np.testing.assert_allclose(log_evidence, posed.exact.log_evidence, atol=2e-5)
    means, covariances = rauch_tung_striebel(posed.matrices, posed.exact)
    smooth = jax.jit(lambda *data: smoothed_moments(posed.model, *data, linearisation=method, num_iterations=3))
    found = smooth(posed.observations, posed.inputs)
    np.testing.assert_allclose(found.mean, means, atol=1e-5)
    np.testing.assert_allclose(found.covariance, covariances, atol=1e-5)


def bent():
    """A state seen by its exponential, with noise that is small beside how this bends; and its moments on a grid."""

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(0.9 * jnp.sin(state["x"]), STEP))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(jnp.exp(state["x"]), NOISE))

    grid = np.linspace(-5.0, 5.0, 2001)
    likelihoods = scipy.stats.norm(np.exp(grid), NOISE).logpdf(np.nan_to_num(YS)[:, None])
    likelihoods = np.where(np.isfinite(YS)[:, None], likelihoods, 0.0)
    steps = scipy.stats.norm(0.9 * np.sin(grid)[:, None], STEP).logpdf(grid)
    exact = grid_filter_smoother(grid, scipy.stats.norm(0.0, 1.0).logpdf(grid), lambda t: steps, likelihoods)
    moments = [(p @ grid, np.sqrt(p @ grid**2 - (p @ grid) ** 2)) for p in exact[:2]]
    model = StateSpaceModel(initial, transition, observation).compile()
    return model, model.observe({"y": YS}), moments


def divergence(gaussian, moments):
    """Mean Kullback-Leibler divergence of Gaussians (T,) from those of the exact moments."""
    mean, spread = np.asarray(gaussian.mean)[:, 0], np.sqrt(np.asarray(gaussian.covariance)[:, 0, 0])
    known, wide = moments
    return np.mean(np.log(spread / wide) + (wide**2 + (mean - known) ** 2) / (2 * spread**2) - 0.5)


@pytest.mark.slow
@every_method
def test_a_bent_observation_is_met_better_around_the_posterior(method):
    """Against a grid: a fifth of the divergence, at most, of filters and smoothers that linearise once."""
    model, observations, (exact_filter, exact_smoother) = bent()
    once, often = (divergence(filtered(model, observations, jnp.zeros(6), method, count)[0], exact_filter) for count in (1, 8))
    assert often < 0.2 * once
    smooth = jax.jit(
        lambda count: smoothed_moments(model, observations, linearisation=method, num_iterations=count), static_argnums=0
    )
    once, often = (divergence(smooth(count), exact_smoother) for count in (1, 8))
    assert often < 0.2 * once


@pytest.mark.full
def test_a_gauss_hermite_grid_is_exact_for_polynomials():
    """E[x^4] and Var[x^4] of x ~ N(1, 4) in two directions, of degrees 4 and 8; sigma points miss them."""
    exact = scipy.stats.norm(1.0, 2.0)
    mean, square = exact.moment(4), exact.moment(8)
    with jax.enable_x64(True):
        start = Gaussian(jnp.array([1.0, 0.0]), jnp.diag(jnp.array([4.0, 1.0])))
        fine, rough = (
            jax.tree.map(np.asarray, predict(start, linearise(lambda x: (x[:1] ** 4 + x[1:], jnp.eye(1)), start, method)))
            for method in ("gauss-hermite", "unscented")
        )
    np.testing.assert_allclose(fine.mean, [mean], rtol=1e-6)
    np.testing.assert_allclose(fine.covariance, [[square - mean**2 + 2.0]], rtol=1e-6)
    assert abs(rough.covariance[0, 0] / (square - mean**2 + 2.0) - 1) > 0.1


@pytest.mark.full
def test_a_grid_of_too_many_coordinates_is_refused():
    with pytest.raises(UnsuitableModelError, match="A Gauss-Hermite grid of 7 coordinates has 5\\^7 points"):
        linearise(lambda x: (x, jnp.eye(7)), Gaussian(jnp.zeros(7), jnp.eye(7)), "gauss-hermite")
