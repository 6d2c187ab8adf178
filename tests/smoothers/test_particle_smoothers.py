"""Particle smoothers one by one: tiles, scales, lost support, the best path by enumeration, windows online and afterwards."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import frame, independent, problem, z_scores
from oracles.kalman import kalman_filter, rauch_tung_striebel
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.linear_gaussian import linear_gaussian, linear_gaussian_matrices, linear_gaussian_model
from smoothing_problems import Smoothing, filtered_history, history_for_conduct

from poseppl.filters import hmc_filter, particle_filter
from poseppl.kernels import HMCSettings
from poseppl.smoothers import (
    History,
    backward_simulation_smoother,
    fixed_lag,
    fixed_lag_smoother,
    forward_backward_smoother,
    genealogy_smoother,
    two_filter_smoother,
    viterbi_smoother,
)

MODEL = problem().model


def smooth(smoother, history, observations, inputs, seed=0):
    return jax.jit(smoother.smooth)(jax.random.key(seed), history, observations, inputs)


def plain_forward_backward(model, history, inputs):
    """Weights (T, N) by the formula, in NumPy and float64, with densities from the model."""
    num_frames = len(history.particles)
    weights = np.exp(np.asarray(history.log_weights, float))
    smoothed = [weights[-1]]
    for t in range(num_frames - 2, -1, -1):

        def density(x, previous, t=t):
            return model.log_transition(x, previous, jax.tree.map(lambda leaf: leaf[t + 1], inputs))

        pairs = jax.vmap(lambda x: jax.vmap(lambda p: density(x, p))(history.particles[t]))(history.particles[t + 1])  # noqa: B023
        log_K = np.asarray(pairs, float)
        K = np.exp(log_K - log_K.max(1, keepdims=True))
        smoothed.append(weights[t] * ((smoothed[-1] / (K @ weights[t])) @ K))
    return np.array(smoothed[::-1])


@pytest.mark.parametrize("tile", [1, 7, None])
def test_forward_backward_is_the_formula_whatever_the_tile(tile):
    history, observations, inputs = history_for_conduct()
    found = smooth(forward_backward_smoother(MODEL, tile=tile), history, observations, inputs)
    np.testing.assert_allclose(np.exp(found.log_weights), plain_forward_backward(MODEL, history, inputs), rtol=2e-4, atol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_densities_beyond_the_range_of_floats_do_no_harm(scale):
    """Weights do not depend on the unit of fifty coordinates; one later particle is out of reach of all the others by far."""
    model = linear_gaussian(50, A=np.eye(50), Q=scale**2 * np.eye(50)).compile()
    particles = 0.3 * jax.random.normal(jax.random.key(0), (3, 30, 50)).at[1, 4].set(20.0)
    ancestors = jnp.tile(jnp.arange(30, dtype=jnp.int32), (3, 1))
    history = History(scale * particles, jnp.full((3, 30), -jnp.log(30.0)), ancestors, jnp.zeros(3, bool))
    found = smooth(forward_backward_smoother(model), history, None, None)
    np.testing.assert_allclose(np.exp(found.log_weights), plain_forward_backward(model, history, None), rtol=5e-3, atol=1e-6)
    drawn = smooth(backward_simulation_smoother(model, 500), history, None, None)
    share = np.mean(np.isclose(drawn.particles[0][:, None], history.particles[0][None]).all(-1), 0)
    assert np.abs(share - np.exp(found.log_weights[0])).max() < 5 * np.sqrt(0.25 / 500)


@pytest.mark.full
def test_later_particles_without_origin_share_their_weight_as_the_filter_does():
    model = finite_hmm([0.5, 0.5], [[1.0, 0.0], [0.0, 1.0]]).compile()
    particles = jnp.array([[0.0, 0.0, 0.0], [0.0, 1.0, 1.0]])[..., None]  # state 1 cannot come from state 0
    log_weights = jnp.log(jnp.array([[0.5, 0.3, 0.2], [0.2, 0.4, 0.4]]))
    history = History(particles, log_weights, jnp.zeros((2, 3), jnp.int32), jnp.zeros(2, bool))
    found = smooth(forward_backward_smoother(model), history, None, None)
    np.testing.assert_allclose(np.exp(found.log_weights[0]), [0.5, 0.3, 0.2], rtol=1e-5)
    assert np.isfinite(smooth(backward_simulation_smoother(model, 8), history, None, None).particles).all()


def test_exact_backward_simulation_draws_by_the_formula():
    """The share of trajectories through each particle of the first frame, against forward-backward weights: 5 sigma."""
    history, observations, inputs = history_for_conduct()
    num = 20_000
    drawn = smooth(backward_simulation_smoother(MODEL, num, tile=5000), history, observations, inputs).particles
    weights = np.exp(smooth(forward_backward_smoother(MODEL), history, observations, inputs).log_weights)
    for t in range(5):
        through = np.isclose(np.asarray(drawn[t])[:, None], np.asarray(history.particles[t])[None]).all(-1)
        share = through.mean(0)
        # the last frame is drawn systematically, every other one independently: binomial is an upper bound of the spread
        assert (np.abs(share - weights[t]) <= 5 * np.sqrt(weights[t] * (1 - weights[t]) / num) + 1e-4).all()


@pytest.mark.full
@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_metropolis_moves_forget_where_they_started(unit):
    """Without a genealogy, and with many moves, shares are those of forward-backward weights, in whatever unit: in the smaller
    one the densities of transitions are up to a million, and a move is weighed by their ratio all the same."""
    history, observations, inputs = history_for_conduct()
    weights = np.exp(smooth(forward_backward_smoother(MODEL), history, observations, inputs).log_weights)
    matrices = problem().matrices
    narrow = {"Q": unit**2 * matrices.Q, "P": unit**2 * matrices.P, "B": unit * matrices.B}
    model = linear_gaussian_model(matrices._replace(**narrow)).compile(inputs[0])
    chains = history._replace(particles=unit * history.particles, ancestors=jnp.zeros((5, 3), jnp.int32))
    smoother = backward_simulation_smoother(model, 20_000, method="metropolis", num_moves=60)
    found = smooth(smoother, chains, observations, inputs)
    through = np.isclose(np.asarray(found.particles[0])[:, None], np.asarray(chains.particles[0])[None], atol=0.0).all(-1)
    assert np.abs(through.mean(0) - weights[0]).max() < 5 * np.sqrt(0.25 / 20_000)
    assert (found.info.acceptance[:-1] > 0.02).all()


@pytest.mark.full
def test_viterbi_finds_the_best_of_all_paths():
    history, observations, inputs = history_for_conduct(4, 4)
    found = smooth(viterbi_smoother(MODEL, tile=3), history, observations, inputs)
    assert found.particles.shape == (4, 1, 2)
    density = jax.jit(jax.vmap(lambda xs: MODEL.log_joint(xs, observations, inputs)))
    paths = np.array(list(itertools.product(range(4), repeat=4)))
    trajectories = np.stack([np.asarray(history.particles[t])[paths[:, t]] for t in range(4)], 1)
    best = trajectories[np.argmax(np.asarray(density(trajectories)))]
    np.testing.assert_array_equal(found.particles[:, 0], best)


@pytest.mark.parametrize("lag", [0, 2, 9])
def test_fixed_lag_online_is_fixed_lag_afterwards(lag):
    posed = problem()
    tracker = fixed_lag(particle_filter(posed.model, 25), lag)
    step = jax.jit(tracker.step)
    keys = jax.random.split(jax.random.key(0), 5)
    state, info = tracker.init(keys[0], *posed.at(0))
    states, infos = [state], [info]
    for t in range(1, 5):
        state, info = step(keys[t], state, *posed.at(t))
        states.append(state)
        infos.append(info)
    history = History(
        jnp.stack([s.particles for s in states]),
        jnp.stack([s.log_weights for s in states]),
        jnp.stack([i.ancestors for i in infos]),
        jnp.stack([i.failed for i in infos]),
    )
    found = smooth(fixed_lag_smoother(posed.model, lag=lag), history, posed.observations, posed.inputs)
    assert state.window.shape == (lag + 1, 25, 2)
    for t in range(5):
        last = min(t + lag, 4)
        window = states[last].window[lag - (last - t)]
        np.testing.assert_array_equal(found.particles[t], window)
        np.testing.assert_allclose(found.log_weights[t], states[last].log_weights, rtol=1e-5)


def test_a_lag_of_all_frames_is_the_genealogy():
    history, observations, inputs = history_for_conduct()
    one = smooth(fixed_lag_smoother(MODEL, lag=4), history, observations, inputs)
    two = smooth(genealogy_smoother(MODEL), history, observations, inputs)
    np.testing.assert_array_equal(one.particles, two.particles)
    np.testing.assert_allclose(one.info.ess, two.info.ess, rtol=1e-5)
    assert two.info.ess[0] < two.info.ess[-1]


@pytest.mark.full
def test_filters_without_genealogy_are_refused():
    history, observations, inputs = history_for_conduct()
    chains = history._replace(ancestors=jnp.zeros((5, 3), jnp.int32))
    for smoother in (genealogy_smoother(MODEL), fixed_lag_smoother(MODEL)):
        with pytest.raises(ValueError, match="forward_backward_smoother"):
            smoother.smooth(jax.random.key(0), chains, observations, inputs)
    tracker = fixed_lag(hmc_filter(MODEL, 3, HMCSettings(num_updates=4, num_leapfrog=2, num_warmup=1)), 2)
    observation, first = frame(observations, 0), frame(inputs, 0)
    state, _ = jax.eval_shape(tracker.init, jax.random.key(0), observation, first)
    with pytest.raises(ValueError, match="one ancestor for each particle"):
        jax.eval_shape(tracker.step, jax.random.key(0), state, observation, first)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: forward_backward_smoother(MODEL, tile=0), "tile is 0"),
        (lambda: viterbi_smoother(MODEL, tile=-1), "tile is -1"),
        (lambda: backward_simulation_smoother(MODEL, 0), "num_trajectories is 0"),
        (lambda: backward_simulation_smoother(MODEL, 5, method="mcmc"), "Expected one of exact, metropolis"),
        (lambda: backward_simulation_smoother(MODEL, 5, num_moves=0), "num_moves is 0"),
        (lambda: two_filter_smoother(MODEL, method="fast"), "Expected one of exact, linear"),
        (lambda: two_filter_smoother(MODEL, inflation=0.5), "inflation is 0.5"),
        (lambda: two_filter_smoother(finite_hmm().compile()), "are integers"),
        (lambda: fixed_lag_smoother(MODEL, lag=-1), "lag is -1"),
        (lambda: fixed_lag(particle_filter(MODEL, 5), -1), "lag is -1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


@pytest.mark.full
@pytest.mark.parametrize("method", ["exact", "linear"])
def test_the_first_frame_of_two_filters_is_free_of_the_artificial_prior(method):
    """Data far from the prediction, at the second frame alone: divided out, the prior leaves Kalman's smoothed mean."""
    matrices = linear_gaussian_matrices(1, A=[[1.0]], Q=[[0.1]], R=[[0.5]])
    model, ys = linear_gaussian_model(matrices).compile(), np.array([[np.nan], [1.5]])
    exact = rauch_tung_striebel(matrices, kalman_filter(matrices, np.nan_to_num(ys), np.isfinite(ys)))
    posed = Smoothing(model, model.observe({"y": ys}), None, *exact)

    def one(key):
        history, observations = filtered_history(key, posed, 500)
        smoothed = two_filter_smoother(model, method=method).smooth(key, history, observations, jnp.zeros(2))
        return jnp.exp(smoothed.log_weights[0]) @ smoothed.particles[0]

    means = np.asarray(independent(one, 100), float)
    assert np.abs(z_scores(means, exact[0][0])).max() < 5
    # with the prior left in it would count twice at the second frame: 5 standard errors are far less than that
    assert 5 * means.std() / 10 < 0.1 * exact[0][0, 0]


def test_the_best_path_begins_by_the_initial_density():
    """From 3 the transition to 1.5 is a little nearer than from 0; the start at 0 is far likelier."""
    model = linear_gaussian(1).compile()
    particles = jnp.array([[[0.0], [3.0]], [[1.5], [1.5]]])
    weights = jnp.full((2, 2), -jnp.log(2.0))
    history = History(particles, weights, jnp.zeros((2, 2), jnp.int32), jnp.zeros(2, bool))
    found = smooth(viterbi_smoother(model), history, model.observe({"y": np.full((2, 1), np.nan)}), None)
    np.testing.assert_allclose(found.particles[:, 0, 0], [0.0, 1.5])


@pytest.mark.full
def test_two_filters_of_a_linear_gaussian_model_have_nearly_equal_weights():
    """Their proposals are all but exact there, of data that tell little; weights that miss a factor would be uneven."""
    matrices = linear_gaussian_matrices(1, R=[[100.0]])
    model, ys = linear_gaussian_model(matrices).compile(), np.full((4, 1), 3.0)
    observations = model.observe({"y": ys})
    posed = Smoothing(model, observations, None, *rauch_tung_striebel(matrices, kalman_filter(matrices, ys)))
    history, _ = filtered_history(jax.random.key(0), posed, 1000)
    found = smooth(two_filter_smoother(model, inflation=1.0), history, observations, jnp.zeros(4))
    assert (np.asarray(found.info.ess) > 900).all()


def test_the_effective_number_counts_the_particles_that_trajectories_pass():
    """Expected number for 60 trajectories, by counting alike states of each frame."""
    history, observations, inputs = history_for_conduct()
    found = smooth(backward_simulation_smoother(MODEL, 60), history, observations, inputs)
    for particles, ess in zip(np.asarray(found.particles), np.asarray(found.info.ess), strict=True):
        counts = np.unique(particles, axis=0, return_counts=True)[1]
        assert ess == pytest.approx(60**2 / np.square(counts).sum(), rel=1e-5)
