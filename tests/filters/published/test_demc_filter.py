"""The DE-MC particle filter: what it targets as published, its estimates and velocity, and its noise."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from law_problems import MASKED, problem, z_scores

from poseppl.filters import DEMCState, demc_filter
from poseppl.filters.published.demc import _noise_factor
from poseppl.program import StateSpaceModel


def likelihood_moments():
    """Mean and covariance of the normalised likelihood of the first frame."""
    posed = problem()
    inverse = np.linalg.inv(posed.matrices.H)
    y = np.asarray(posed.observations.values["y"][0], float)
    return inverse @ y, inverse @ posed.matrices.R @ inverse.T


def test_ancestors_are_those_of_the_selection():
    """As published, particles are selected by the last frame's weights: here one has them all."""
    posed = problem()
    particles = jax.random.normal(jax.random.key(1), (20, 2))
    state = DEMCState(particles, jnp.full(20, -jnp.inf).at[7].set(0.0), particles[7], jnp.zeros(2))
    step = jax.jit(demc_filter(posed.model, 20, num_layers=1).step)
    _, info = step(jax.random.key(0), state, *posed.at(1))
    np.testing.assert_array_equal(info.ancestors, 7)


@pytest.mark.full
def test_many_layers_lead_to_the_likelihood_not_to_the_posterior():
    posed = problem()
    init = demc_filter(posed.model, 100, num_layers=40, noise_follows="nothing").init
    keys = jax.random.split(jax.random.key(0), 40)
    run = jax.jit(lambda keys: jax.lax.map(lambda k: init(k, *posed.at(0))[0], keys))
    particles = np.asarray(run(keys).particles, float)
    mean, covariance = likelihood_moments()
    centred = particles - mean
    seconds = np.einsum("kni,knj->kij", centred, centred) / 100
    assert np.abs(z_scores(particles.mean(1), mean)).max() < 5
    assert np.abs(z_scores(seconds, covariance)).max() < 5
    assert np.abs(z_scores(particles.mean(1), posed.exact.means[0])).max() > 5
    assert np.abs(z_scores(seconds, posed.exact.covariances[0])).max() > 10


@pytest.fixture(scope="module")
def frames():
    """States of a run as published, frame by frame."""
    posed = problem()
    built = demc_filter(posed.model, 60, num_layers=3, prediction="velocity")
    init, step = jax.jit(built.init), jax.jit(built.step)
    keys = jax.random.split(jax.random.key(0), 4)
    found = [init(keys[0], *posed.at(0))]
    for t in (1, 2, 3):
        found.append(step(keys[t], found[-1][0], *posed.at(t)))
    return posed, found


@pytest.mark.full
def test_weights_are_likelihoods_and_the_best_has_the_largest(frames):
    posed, found = frames
    for t in (0, 1, 3):
        state, info = found[t]
        values = [posed.model.log_observation(x, *posed.at(t)) for x in state.particles]
        np.testing.assert_allclose(state.log_weights, np.array(values) - np.logaddexp.reduce(values), atol=1e-4)
        np.testing.assert_array_equal(state.best, state.particles[np.argmax(values)])
        assert 0.1 < info.acceptance < 1


@pytest.mark.full
def test_velocity_is_what_the_estimate_moved(frames):
    _, found = frames
    assert (np.asarray(found[0][0].velocity) == 0).all()
    for (before, _), (after, _) in zip(found[:-1], found[1:], strict=True):
        np.testing.assert_allclose(after.velocity, after.best - before.best, atol=1e-6)


@pytest.mark.full
def test_without_data_particles_move_by_the_velocity(frames):
    _, found = frames
    (before, _), (after, info) = found[MASKED - 1], found[MASKED]
    expected = before.particles[info.ancestors] + before.velocity
    np.testing.assert_allclose(after.particles, expected, atol=1e-6)


def test_noise_follows_the_survival_diagnostic():
    values = jnp.log(jnp.array([0.5, 0.5, 0.0, 0.0]))
    assert abs(float(_noise_factor(values, "survival")) - 0.5) < 1e-6
    assert abs(float(_noise_factor(values, "degeneracy")) - 2.0) < 1e-6
    assert float(_noise_factor(values, "nothing")) == 1.0
    assert float(_noise_factor(jnp.full(4, -jnp.inf), "survival")) == 0.25


def test_copies_are_parted_by_the_noise_of_the_transition():
    """Copies have no standard deviations; one layer moves them by at most c times those of a step of the transition."""
    posed = problem()
    state = DEMCState(jnp.zeros((200, 2)), jnp.full(200, -jnp.log(200.0)), jnp.zeros(2), jnp.zeros(2))
    settings = {"num_layers": 1, "prediction": "velocity", "noise": 0.5, "noise_follows": "nothing"}
    for scale in ("particles", "transition"):
        step = jax.jit(demc_filter(posed.model, 200, noise_scale=scale, **settings).step)
        moved = np.asarray(step(jax.random.key(0), state, *posed.at(1))[0].particles)[::2]  # the half that moves first
        reach = 0.5 * np.sqrt(np.diag(posed.matrices.Q)) * (scale == "transition")
        assert (np.abs(moved).max(0) <= 1.2 * reach).all() and (np.abs(moved).max(0) >= 0.7 * reach).all()


def within_limits(drift=0.0):
    """A coordinate between hard limits at -1 and 1, seen at 0.9, that drifts in each frame."""

    def initial(params, inputs):
        numpyro.sample("x", dist.Normal(0.0, 0.3))

    def transition(params, state, inputs):
        numpyro.sample("x", dist.Normal(state["x"] + drift, 0.05))

    def observation(params, state, inputs):
        numpyro.sample("y", dist.Normal(state["x"], 0.1))
        numpyro.factor("limits", jnp.where(jnp.abs(state["x"]) < 1, 0.0, -jnp.inf))

    return StateSpaceModel(initial, transition, observation).compile()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "prediction"), [("likelihood", "velocity"), ("likelihood", "transition"), ("posterior", "")]
)
def test_predictions_beyond_hard_limits_find_back(target, prediction):
    model = within_limits(drift=0.0 if prediction == "velocity" else 0.6)
    filter = demc_filter(model, 60, target=target, prediction=prediction or "transition")
    step, seen = jax.jit(filter.step), model.observe({"y": 0.9})
    particles = jnp.linspace(0.5, 0.9, 60)[:, None]
    state = DEMCState(particles, jnp.full(60, -jnp.log(60.0)), particles[-1], jnp.full(1, 0.6))
    for frame_ in range(4):
        state, info = step(jax.random.key(frame_), state, seen)
        weights = np.exp(state.log_weights)
        assert not info.failed
        assert weights[np.abs(state.particles[:, 0]) >= 1].sum() == 0 and weights.sum() == pytest.approx(1, abs=1e-5)
    assert abs(float(weights @ state.particles[:, 0]) - 0.9) < 0.1


@pytest.mark.full
def test_a_velocity_that_led_nowhere_is_dropped():
    model = within_limits()
    step = jax.jit(demc_filter(model, 60, prediction="velocity").step)
    lost = DEMCState(jnp.full((60, 1), 3.0), jnp.full(60, -jnp.log(60.0)), jnp.full(1, 3.0), jnp.full(1, 0.6))
    state, info = step(jax.random.key(0), lost, model.observe({"y": 0.9}))
    assert info.failed and info.num_likelihood == 60 * 9
    np.testing.assert_allclose(state.particles, 3.6, rtol=1e-6)
    again, _ = step(jax.random.key(1), state, model.observe({"y": 0.9}))
    np.testing.assert_array_equal(again.particles, state.particles)


@pytest.mark.full
@pytest.mark.parametrize(("target", "num_particles"), [("likelihood", 1), ("posterior", 5)])
def test_one_particle_and_equal_particles(target, num_particles):
    posed = problem()
    step = jax.jit(demc_filter(posed.model, num_particles, target=target, num_layers=2).step)
    weights = jnp.full(num_particles, -jnp.log(num_particles))
    state = DEMCState(jnp.zeros((num_particles, 2)), weights, jnp.zeros(2), jnp.zeros(2))
    after, info = step(jax.random.key(0), state, *posed.at(1))
    assert all(np.isfinite(np.asarray(leaf, float)).all() for leaf in after)
    assert np.isfinite(info.log_evidence) and not info.failed


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"num_particles": 0}, "num_particles"),
        ({"num_layers": 0}, "num_layers"),
        ({"noise": 1.0}, "noise"),
        ({"target": "mixture"}, "target"),
        ({"prediction": "drift"}, "prediction"),
        ({"noise_follows": "weights"}, "noise_follows"),
        ({"noise_scale": "weights"}, "noise_scale"),
        ({"snooker": 2.0}, "snooker"),
        ({"resampling": "sistematic"}, "sistematic"),
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(settings, word):
    with pytest.raises(ValueError, match=word):
        demc_filter(problem().model, **{"num_particles": 10, **settings})
