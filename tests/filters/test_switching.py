"""The switching Gaussian filter where it is exact, and how near it is where it is not."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import Problem, frame, run
from oracles.switching import switching_filter as enumerate_all

from poseppl.errors import UnsuitableModelError
from poseppl.filters import switching_filter
from poseppl.program import StateSpaceModel
from poseppl.runs.collectors import collect_draws

FIRST, TRANSITION = np.array([0.3, 0.7]), np.array([[0.6, 0.4], [0.25, 0.75]])
MEANS, SDS = np.array([-1.0, 0.8]), np.array([0.4, 0.7])
DATA = np.array([0.2, 1.1, np.nan, -0.6, 0.4])


def posed(kept):
    """x_t ~ N(kept x_(t-1) + mu_k, sigma_k^2), seen with noise; exact where nothing is kept."""

    def start(params, inputs):
        k = numpyro.sample("k", dist.Categorical(probs=FIRST))
        numpyro.sample("x", dist.Normal(jnp.asarray(MEANS)[k], jnp.asarray(SDS)[k]))

    def move(params, state, inputs):
        k = numpyro.sample("k", dist.Categorical(probs=jnp.asarray(TRANSITION)[state["k"]]))
        numpyro.sample("x", dist.Normal(kept * state["x"] + jnp.asarray(MEANS)[k], jnp.asarray(SDS)[k]))

    model = StateSpaceModel(
        start, move, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 0.3))
    ).compile()

    def law(k):
        return np.array([MEANS[k]]), np.array([[SDS[k] ** 2]])

    seen = (np.eye(1), np.zeros(1), 0.09 * np.eye(1))
    exact = enumerate_all(FIRST, TRANSITION, law, lambda _, k: (kept * np.eye(1), *law(k)), seen, DATA[:, None])
    return Problem(None, model, model.observe({"y": DATA}), None, exact)


def answer(kept):
    """Probabilities of the second value (T,), means (T,) and evidence increments (T,)."""
    problem = posed(kept)
    built = switching_filter(problem.model, 10)
    states, infos = jax.jit(lambda key, data: run(built, key, data, None))(jax.random.key(0), problem.observations)
    masses = np.exp(states.log_masses)
    return problem.exact, masses[:, 1], np.sum(masses * states.means[:, :, 0], 1), infos.log_evidence


def test_it_is_exact_where_the_past_is_forgotten():
    exact, chances, means, increments = answer(0.0)
    np.testing.assert_allclose(chances, exact.means[:, 0], atol=1e-5)
    np.testing.assert_allclose(means, exact.means[:, 1], atol=1e-5)
    np.testing.assert_allclose(increments, exact.log_evidence, atol=1e-5)


@pytest.mark.full
def test_summaries_are_of_the_mixture_not_of_draws():
    problem = posed(0.0)
    state, info = switching_filter(problem.model, 10).init(jax.random.key(0), frame(problem.observations, 0), None)
    kept = jax.jit(collect_draws(problem.model))(jax.random.key(1), state, info, None).summary
    mean, covariance = problem.exact.means[0], problem.exact.covariances[0]
    np.testing.assert_allclose(kept["state_mean"], mean, atol=1e-5)
    np.testing.assert_allclose(kept["x_sd"], np.sqrt(covariance[1, 1]), atol=1e-5)
    np.testing.assert_allclose(kept["k_probability"], [1 - mean[0], mean[0]], atol=1e-5)


@pytest.mark.full
def test_it_is_near_where_moments_of_the_past_are_matched():
    exact, chances, means, increments = answer(0.7)
    np.testing.assert_allclose(means[:2], exact.means[:2, 1], atol=0.02)
    assert np.abs(means - exact.means[:, 1]).max() < 0.05
    assert np.abs(chances - exact.means[:, 0]).max() < 0.05
    assert 1e-4 < np.abs(increments - exact.log_evidence).max() < 0.1


@pytest.mark.full
def test_draws_are_of_the_gaussians():
    problem = posed(0.0)
    state, _ = switching_filter(problem.model, 20_000).init(jax.random.key(0), frame(problem.observations, 0), None)
    mean, covariance = problem.exact.means[0], problem.exact.covariances[0]
    errors = (np.asarray(state.particles).mean(0) - mean) / np.sqrt(np.diag(covariance) / 20_000)
    assert np.abs(errors).max() < 5


@pytest.mark.full
def test_several_finite_sites_are_refused():
    def start(params, *rest):
        numpyro.sample("k", dist.Bernoulli(0.5).expand((2,)).to_event(1))
        numpyro.sample("x", dist.Normal(0.0, 1.0))

    model = StateSpaceModel(
        start, start, lambda params, state, inputs: numpyro.sample("y", dist.Normal(state["x"], 1.0))
    ).compile()
    with pytest.raises(UnsuitableModelError, match=r"finite sites \['k'\]. Expected a single one"):
        switching_filter(model)


ROOTS = np.array([[[0.5, 0.0], [0.4, 0.3]], [[0.2, 0.0], [-0.6, 0.7]]])
"""Square roots of the covariances of two coordinates, given k."""
CENTRES = np.array([[1.0, -2.0], [0.0, 1.5]])


def in_two_coordinates(transition, by_past, data, first=FIRST):
    """x_t ~ N(A x_(t-1) + c, S_k S_k'), c being the centre of k_t, or twice that of k_(t-1); x is seen with noise."""
    turn = np.array([[0.6, 0.3], [-0.2, 0.5]])

    def start(params, inputs):
        k = numpyro.sample("k", dist.Categorical(probs=first))
        numpyro.sample("x", dist.MultivariateNormal(jnp.asarray(CENTRES)[k], scale_tril=jnp.asarray(ROOTS)[k]))

    def move(params, state, inputs):
        k = numpyro.sample("k", dist.Categorical(probs=jnp.asarray(transition)[state["k"]]))
        centre = 2 * jnp.asarray(CENTRES)[state["k"]] if by_past else jnp.asarray(CENTRES)[k]
        mean = jnp.asarray(turn) @ state["x"] + centre
        numpyro.sample("x", dist.MultivariateNormal(mean, scale_tril=jnp.asarray(ROOTS)[k]))

    def look(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 0.5).to_event(1))

    model = StateSpaceModel(start, move, look).compile()

    def later(j, k):
        return turn, 2 * CENTRES[j] if by_past else CENTRES[k], ROOTS[k] @ ROOTS[k].T

    def law(k):
        return CENTRES[k], ROOTS[k] @ ROOTS[k].T

    exact = enumerate_all(first, transition, law, later, (np.eye(2), np.zeros(2), 0.25 * np.eye(2)), data)
    return Problem(None, model, model.observe({"y": data}), None, exact)


def moments_of(states):
    """Means (T, 3) and covariances (T, 3, 3) of the mixture, in the order k, x."""
    masses, means, scales = (np.asarray(each, float) for each in (states.log_masses, states.means, states.scales))
    weights = np.exp(masses)
    values = np.broadcast_to(np.arange(2.0)[:, None], (len(means), 2, 1))
    centres = np.concatenate([values, means], 2)
    mean = np.einsum("tk,tki->ti", weights, centres)
    apart = centres - mean[:, None]
    covariance = np.einsum("tk,tki,tkj->tij", weights, apart, apart)
    covariance[:, 1:, 1:] += np.einsum("tk,tkij,tklj->til", weights, scales, scales)
    return mean, covariance


@pytest.mark.parametrize("by_past", [pytest.param(False, marks=pytest.mark.full), True])
def test_two_moments_of_a_mixture_of_pasts_are_kept(by_past):
    """Frames: one that is seen, and one that is not, whose moments are exact where all are linear; k swaps where it decides."""
    transition = np.array([[1e-6, 1 - 1e-6], [1 - 1e-6, 1e-6]]) if by_past else TRANSITION
    posed = in_two_coordinates(transition, by_past, np.array([[0.2, 0.4], [np.nan, np.nan]]))
    built = switching_filter(posed.model, 10)
    states, infos = jax.jit(lambda key, data: run(built, key, data, None))(jax.random.key(0), posed.observations)
    mean, covariance = moments_of(states)
    np.testing.assert_allclose(infos.log_evidence, posed.exact.log_evidence, atol=1e-4)
    np.testing.assert_allclose(mean, posed.exact.means, atol=1e-4)
    np.testing.assert_allclose(covariance, posed.exact.covariances, atol=1e-4)
