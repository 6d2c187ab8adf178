"""Proposals of a user, and the local one where it has to adapt to each particle."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import scipy.stats
from law_problems import check_impossible, problem, replicate, z_scores
from oracles.quadrature import moments_on_grid
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.filters import guided_filter, particle_filter
from poseppl.filters.local_proposal import local_proposal
from poseppl.program import Proposal

POSED = problem()


def halfway(params, state, inputs, observation):
    """Half of the way to what was seen, wide enough."""
    mean = jnp.asarray([[0.9, 0.2], [-0.1, 0.8]]) @ state["x"]
    pull = jnp.where(observation.mask["y"], observation.values["y"] - mean, 0.0)
    numpyro.sample("x", dist.Normal(mean + 0.3 * pull, 0.9).to_event(1))


def wide(params, inputs, observation):
    numpyro.sample("x", dist.Normal(jnp.zeros(2), 1.5).to_event(1))


@pytest.mark.full
@pytest.mark.parametrize("auxiliary", [False, True])
def test_a_proposal_program_changes_nothing_but_the_variance(auxiliary):
    filter = guided_filter(POSED.model, 1000, proposal=Proposal(halfway, wide), auxiliary=auxiliary)
    means, seconds, increments = replicate(filter, POSED, 60)
    assert np.abs(z_scores(means, POSED.exact.means)).max() < 5
    assert np.abs(z_scores(seconds, POSED.exact.covariances)).max() < 5
    ratio = np.exp(increments.sum(1) - POSED.exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) < 5


@pytest.mark.full
def test_a_proposal_that_is_not_weighted_is_noticed(monkeypatch):
    import poseppl.filters.guided as guided

    original = guided.propose_transition

    def forgetful(model, proposal, observation, inputs):
        made = original(model, proposal, observation, inputs)
        return made._replace(log_density=lambda x, before: model.log_transition(x, before, inputs))

    monkeypatch.setattr(guided, "propose_transition", forgetful)
    other = problem().model  # nothing was built for it before
    means, _, _ = replicate(guided_filter(other, 1000, proposal=Proposal(halfway, wide)), POSED, 60)
    assert np.abs(z_scores(means, POSED.exact.means)).max() > 20


@pytest.mark.full
def test_the_local_proposal_needs_fewer_particles_than_the_transition():
    exact = POSED.exact.log_evidence.sum()
    spread = {}
    for name, build in (("guided", guided_filter), ("bootstrap", particle_filter)):
        _, _, increments = replicate(build(POSED.model, 300), POSED, 40)
        spread[name] = np.std(increments.sum(1) - exact)
    assert spread["guided"] < spread["bootstrap"] / 2


@pytest.mark.full
@pytest.mark.parametrize("auxiliary", [False, True])
def test_a_curvature_that_depends_on_the_particle(auxiliary):
    """Growth model, two frames, against quadrature over both states."""
    model = growth().compile(jnp.float32(1.0))
    times, data = np.array([1.0, 2.0], np.float32), np.array([4.0, 1.5])
    observations = model.observe({"y": data})
    filter = guided_filter(model, 2000, auxiliary=auxiliary)

    def log_joint(points):
        return jax.vmap(lambda xs: model.log_joint(xs[:, None], observations, jnp.asarray(times)))(jnp.asarray(points))

    axis = np.linspace(-30, 30, 601)
    log_evidence, mean, _ = moments_on_grid(log_joint, (axis, axis))

    @jax.jit
    def one(key):
        key_init, key_step = jax.random.split(key)
        rows = [jax.tree.map(lambda leaf, t=t: jnp.asarray(leaf)[t], (observations, times)) for t in (0, 1)]
        state, first = filter.init(key_init, *rows[0])
        state, second = filter.step(key_step, state, *rows[1])
        return jnp.exp(state.log_weights) @ state.particles[:, 0], first.log_evidence + second.log_evidence

    means, increments = jax.lax.map(one, jax.random.split(jax.random.key(0), 60))
    assert abs(z_scores(np.asarray(means, float), mean[1])) < 5
    assert abs(z_scores(np.exp(np.asarray(increments, float) - log_evidence), 1.0)) < 5


@pytest.mark.full
def test_a_proposal_of_other_sites_is_refused():
    def misspelt(params, state, inputs, observation):
        numpyro.sample("xx", dist.Normal(state["x"], 1.0).to_event(1))

    filter = guided_filter(POSED.model, 10, proposal=Proposal(misspelt))
    first = jax.tree.map(lambda leaf: leaf[0], (POSED.observations, POSED.inputs))
    state, _ = filter.init(jax.random.key(0), *first)
    with pytest.raises(ValueError, match="'xx'"):
        filter.step(jax.random.key(0), state, *first)


def test_settings_are_checked():
    with pytest.raises(ValueError, match="num_particles is 0"):
        guided_filter(POSED.model, 0)
    with pytest.raises(ValueError, match="ess_threshold is 2"):
        guided_filter(POSED.model, 10, ess_threshold=2)


def test_the_local_predictive_likelihood_is_exact_for_linear_gaussian_programs():
    """log N(y; H (A x + B u), H Q H^T + R) of each ancestor x."""
    A, Q, H, R, _, _, B = POSED.matrices
    ancestors = np.random.default_rng(0).normal(size=(6, 2)).astype(np.float32)
    seen, inputs = jax.tree.map(lambda leaf: leaf[1], (POSED.observations, POSED.inputs))
    local = local_proposal(POSED.model, lambda x: POSED.model.transition_moments(x, inputs), ancestors, seen, inputs)
    means = (ancestors @ A.T + B @ np.asarray(inputs)) @ H.T
    expected = scipy.stats.multivariate_normal(cov=H @ Q @ H.T + R).logpdf(np.asarray(seen.values["y"]) - means)
    np.testing.assert_allclose(local.log_predictive, expected, rtol=1e-4, atol=1e-4)


def shifted(params, state, inputs, observation):
    """The transition, wider and beside itself."""
    mean = jnp.asarray([[0.9, 0.2], [-0.1, 0.8]]) @ state["x"] + jnp.asarray([1.0, 0.5]) * inputs[0]
    numpyro.sample("x", dist.Normal(mean + 0.4, 0.8).to_event(1))


def test_after_an_impossible_frame_particles_are_weighted_draws_of_the_prediction():
    """The proposal's p / q is all that they are weighted by there; what follows is Kalman's without that frame."""
    check_impossible(guided_filter(POSED.model, 1000, proposal=Proposal(shifted, wide)), POSED, 60)


@pytest.mark.slow
def test_the_auxiliary_filter_reports_the_lesser_ess_of_its_stages():
    """On a linear model the second stage has equal weights, and the first all that there is to lose."""
    model = linear_gaussian(12, R=0.01 * np.eye(12)).compile()
    filter = guided_filter(model, 200, auxiliary=True)
    data = model.observe({"y": np.random.default_rng(0).normal(size=(2, 12))})
    first, second = (jax.tree.map(lambda leaf, t=t: leaf[t], data) for t in (0, 1))
    state, info = filter.init(jax.random.key(0), first)
    assert info.ess == pytest.approx(200, rel=1e-3)
    _, info = filter.step(jax.random.key(1), state, second)
    A = 0.9 * np.eye(12) + 0.1 * np.eye(12, k=1)
    residuals = second.values["y"] - np.asarray(state.particles) @ A.T
    weights = np.exp(-0.5 * np.square(residuals).sum(axis=1) / 0.26)
    weights /= weights.sum()
    assert info.ess == pytest.approx(1 / np.square(weights).sum(), rel=1e-2) and info.ess < 190
