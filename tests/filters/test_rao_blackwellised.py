"""The Rao-Blackwellised filter against the sum over all histories of the finite site."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import run, z_scores
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from test_switching import TRANSITION, in_two_coordinates, posed

from poseppl.errors import UnsuitableModelError
from poseppl.filters import kalman_filter, rao_blackwellised_filter, switching_filter
from poseppl.program import StateSpaceModel
from poseppl.runs.site_summary import site_probabilities

REPLICATES = 400
KEPT = 0.7


@pytest.fixture(scope="module")
def found():
    """Probabilities (K, T) of the second value, means (K, T), second moments (K, T) of x, and evidence (K, T)."""
    problem = posed(KEPT)
    built = rao_blackwellised_filter(problem.model, 50)

    def one(key, data):
        states, infos = run(built, key, data, None)
        weights = jnp.exp(states.log_weights)
        mean = states.real.mean[..., 0]
        chance = jax.vmap(lambda x, weight: site_probabilities(problem.model, x, weight)["k"][1])(states.particles, weights)
        seconds = jnp.sum(weights * (states.real.covariance[..., 0, 0] + mean**2), 1)
        draws = jnp.sum(weights * states.particles[..., 1], 1)
        told = jax.vmap(lambda each: each.mean)(states.marginals)
        return chance, jnp.sum(weights * mean, 1), seconds, draws, told, infos.log_evidence

    run_all = jax.jit(lambda keys, data: jax.lax.map(lambda key: one(key, data), keys))
    keys = jax.random.split(jax.random.key(0), REPLICATES)
    return [np.asarray(part, float) for part in run_all(keys, problem.observations)]


def test_it_is_the_sum_over_all_histories(found):
    """Probabilities, means and variances, of a state that remembers its past; weights' bias is O(1 / N)."""
    exact = posed(KEPT).exact
    chances, means, seconds, draws, told, _ = found
    np.testing.assert_allclose(told, np.stack([chances, means], 2), atol=1e-5)
    for samples, truth in (
        (chances, exact.means[:, 0]),
        (means, exact.means[:, 1]),
        (seconds, exact.covariances[:, 1, 1] + exact.means[:, 1] ** 2),
        (draws, exact.means[:, 1]),
    ):
        assert np.abs(samples.mean(0) - truth).max() < 0.01
        assert (np.abs(samples.mean(0) - truth) < 5 * samples.std(0, ddof=1) / np.sqrt(REPLICATES) + 0.002).all()


def test_its_evidence_is_unbiased(found):
    exact = posed(KEPT).exact
    ratio = np.exp(found[-1].sum(1) - exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) < 5
    assert ratio.std() < 0.5


@pytest.mark.full
def test_matched_moments_are_noticed(found):
    """The switching filter, which matches two moments of the past, is farther off than the error of the replicates."""
    problem = posed(KEPT)
    built = switching_filter(problem.model, 10)
    states, _ = jax.jit(lambda key, data: run(built, key, data, None))(jax.random.key(0), problem.observations)
    matched = np.sum(np.exp(states.log_masses) * states.means[:, :, 0], 1)
    errors = found[1].std(0, ddof=1) / np.sqrt(REPLICATES)
    assert (np.abs(matched - problem.exact.means[:, 1]) / errors).max() > 5


@pytest.mark.full
def test_a_finite_site_that_depends_on_a_real_one_is_refused():
    def start(params, inputs):
        numpyro.sample("k", dist.Bernoulli(0.5))
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    def move(params, state, inputs):
        numpyro.sample("k", dist.Bernoulli(logits=state["x"]))
        numpyro.sample("x", dist.Normal(state["x"], 1.0))

    model = StateSpaceModel(
        start, move, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 1.0))
    ).compile()
    built, data = rao_blackwellised_filter(model, 5), model.observe({"y": 0.3})
    state, _ = jax.eval_shape(built.init, jax.random.key(0), data)
    with pytest.raises(UnsuitableModelError, match="finite site of the transition program.*depends on real ones"):
        jax.eval_shape(built.step, jax.random.key(1), state, data)


@pytest.mark.full
def test_a_model_without_finite_sites_or_inputs_is_one_gaussian():
    model = linear_gaussian_model(linear_gaussian_matrices(1)).compile()
    data = model.observe({"y": jnp.full(1, 0.3)})
    (state, info), (exact, its_info) = (
        built.init(jax.random.key(0), data) for built in (rao_blackwellised_filter(model, 2), kalman_filter(model, 2))
    )
    np.testing.assert_allclose(state.marginals.mean, exact.marginals.mean, rtol=1e-5)
    np.testing.assert_allclose(info.log_evidence, its_info.log_evidence, rtol=1e-5)


def test_transitions_that_depend_on_the_value_before_and_draws_that_hang_together():
    """Two coordinates of which the past value decides the mean; both frames against the sum over all histories."""
    posed, number = in_two_coordinates(TRANSITION, True, np.array([[np.nan, np.nan], [1.2, -0.5]])), 20_000
    built = rao_blackwellised_filter(posed.model, number)
    states, infos = jax.jit(lambda key, data: run(built, key, data, None))(jax.random.key(0), posed.observations)
    weights, means = np.exp(np.asarray(states.log_weights, float)), np.asarray(states.real.mean, float)
    ess = 1 / np.square(weights).sum(1)
    for t, (mean, covariance) in enumerate(zip(posed.exact.means, posed.exact.covariances, strict=True)):
        error = np.sqrt(np.diag(covariance)[1:] / ess[t])
        assert (np.abs(weights[t] @ means[t] - mean[1:]) < 5 * error).all()
        # a draw is its Gaussian's: of its own covariance, on average over particles
        drawn = np.asarray(states.particles[t, :, 1:], float)
        found = np.cov(drawn.T, aweights=weights[t])
        limit = 5 * np.sqrt(np.outer(*2 * [np.diag(covariance)[1:]]) * 2 / ess[t])
        assert (np.abs(found - covariance[1:, 1:]) < limit).all()
        apart = drawn - means[t]
        own = np.asarray(states.real.covariance[t], float)
        white = np.linalg.solve(np.linalg.cholesky(own), apart[..., None])[..., 0]
        assert (np.abs(white.T @ white / number - np.eye(2)) < 5 * np.sqrt(2 / number)).all()
    assert abs(infos.log_evidence.sum() - posed.exact.log_evidence.sum()) < 5 / np.sqrt(ess.min())
