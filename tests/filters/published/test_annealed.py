"""The annealed particle filter seeks the mode of the likelihood, and is no sampler of the posterior."""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import MASKED, problem, replicate, z_scores
from poseppl_models.toys.linear_gaussian import linear_gaussian

from poseppl.filters import AnnealedState, annealed_filter
from poseppl.filters.published.annealed import Annealing, _cross, _Layer, _refine, annealing_exponent, predict_by_transition
from poseppl.particles.resampling import systematic
from poseppl.particles.weights import effective_sample_size


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("survival", [0.2, 0.5, 0.9])
def test_the_fraction_asked_survives(survival, scale):
    values = scale * (3.0 - jax.random.normal(jax.random.key(0), (1000,)) ** 2).at[7].set(-jnp.inf)
    exponent = annealing_exponent(values, survival)
    ess = effective_sample_size(exponent * (values - values.max()))
    np.testing.assert_allclose(ess, survival * 999, rtol=1e-3)


@pytest.mark.full
def test_the_exponent_of_equal_values_is_finite():
    for values in ([-1.0] * 5, [-jnp.inf] * 5, [-jnp.inf, 2.0], [0.0]):
        assert np.isfinite(annealing_exponent(jnp.array(values), 0.5))


@cache
def first_frame(num_layers, num_particles=400, **settings):
    """Weighted means (K, d), second moments about the posterior's mean and best particles at the first frame."""
    posed = problem()
    init = annealed_filter(posed.model, num_particles, num_layers=num_layers, **settings).init

    def one(key):
        state, _ = init(key, *posed.at(0))
        weights = jnp.exp(state.log_weights)
        mean = weights @ state.particles
        return mean, weights @ (state.particles - mean) ** 2, state.best

    keys = jax.random.split(jax.random.key(0), 40)
    found = jax.jit(lambda keys: jax.lax.map(one, keys))(keys)
    return tuple(np.asarray(a, float) for a in found)


def likeliest():
    posed = problem()
    return np.linalg.solve(posed.matrices.H, np.asarray(posed.observations.values["y"][0], float))


def test_particles_gather_at_the_mode_of_the_likelihood():
    distances, spreads = [], []
    for num_layers in (1, 10):
        means, variances, best = first_frame(num_layers)
        distances.append(np.abs(means.mean(0) - likeliest()).max())
        spreads.append(np.sqrt(variances.mean(0)).max())
    assert distances[0] > 0.1 and distances[1] < 0.02
    # the noise of the layers is what is left: its standard deviation falls by sqrt(tau) a layer
    assert spreads[0] > 5 * spreads[1]
    assert np.abs(best - likeliest()).max() < 0.2


@pytest.mark.full
def test_it_is_not_the_posterior():
    """Means are off and variances too small by far, which no number of particles corrects."""
    posed = problem()
    for num_particles in (400, 2000):
        means, variances, _ = first_frame(10, num_particles)
        assert np.abs(z_scores(means, posed.exact.means[0])).max() > 20
        assert (variances.mean(0) < 0.3 * np.diag(posed.exact.covariances[0])).all()


@pytest.mark.full
def test_a_frame_without_data_is_predicted():
    """No noise is added to the transition's: the variance grows by Q about the predicted means."""
    posed = problem()
    built = annealed_filter(posed.model, 1000, num_layers=6)
    means, seconds, increments = replicate(built, posed, 20)
    A, Q = posed.matrices.A, posed.matrices.Q
    centre = means.mean(0)
    covariance = seconds.mean(0) - np.einsum("ti,tj->tij", *(2 * [centre - posed.exact.means]))
    predicted = A @ covariance[MASKED - 1] @ A.T + Q
    np.testing.assert_allclose(covariance[MASKED], predicted, atol=0.03)
    assert (increments[:, MASKED] == 0).all()


def test_noise_of_a_layer_falls_by_the_survival_rate():
    """A diffusion of 100 drowns the prediction: what is left after one layer of noise has the variance tau 100."""
    posed, survival = problem(), 0.3
    init = jax.jit(annealed_filter(posed.model, 4000, num_layers=2, survival=survival, diffusion=np.full(2, 100.0)).init)
    state, _ = init(jax.random.key(0), *posed.at(0))
    # the prediction's own variance of at most 1 comes on top
    np.testing.assert_allclose(np.asarray(state.particles).var(0), 100 * survival, rtol=5 * np.sqrt(2 / 4000) + 0.02)


def test_crossover_takes_whole_groups_from_either_parent():
    particles = jnp.arange(50.0)[:, None] + jnp.array([0.0, 100.0, 200.0, 300.0, 400.0])
    groups = np.array([1, 0, 1, 2, 2])
    log_weights = jnp.full(50, -jnp.log(50.0)).at[0].set(-jnp.inf)
    children = np.asarray(_cross(jax.random.key(0), particles, particles, log_weights, groups)) % 100
    own = np.arange(50)
    assert (children[:, 1] == own).all()
    assert (children[:, 0] == children[:, 2]).all() and (children[:, 3] == children[:, 4]).all()
    assert (children[:, 0] != children[:, 3]).any()
    for column in (0, 3):
        share = np.mean(children[:, column] != own)
        assert abs(share - 0.5) < 5 * 0.5 / np.sqrt(50)
        assert not (children[1:, column] == 0).any()


@pytest.mark.full
def test_crossover_joins_what_different_particles_found():
    means, _, best = first_frame(6, 30, crossover=(("x[0]",), ("x[1]",)))
    assert np.abs(best.mean(0) - likeliest()).max() < 0.1
    assert np.isfinite(means).all()


@pytest.mark.full
@pytest.mark.parametrize("num_particles", [1, 5])
def test_one_particle_and_equal_particles(num_particles):
    posed = problem()
    step = jax.jit(annealed_filter(posed.model, num_particles, num_layers=3, diffusion=np.zeros(2)).step)
    weights = jnp.full(num_particles, -jnp.log(num_particles))
    state = AnnealedState(jnp.zeros((num_particles, 2)), weights, jnp.zeros(2))
    state, info = step(jax.random.key(0), state, *posed.at(1))
    assert np.isfinite(state.particles).all() and np.isfinite(state.log_weights).all()
    assert np.isfinite(info.log_evidence) and not info.failed
    # without noise between the layers, particles are copies of those predicted
    assert len(np.unique(np.asarray(state.particles), axis=0)) <= max(1, num_particles - 1)


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"num_particles": 0}, "num_particles"),
        ({"num_layers": 0}, "num_layers"),
        ({"survival": 1.0}, "survival"),
        ({"diffusion": np.ones(3)}, "diffusion"),
        ({"diffusion": -np.ones(2)}, "diffusion"),
        ({"crossover": [[0, 2]]}, "crossover"),
        ({"crossover": [["hip"]]}, "crossover"),
        ({"crossover": [[0], ["x[0]"]]}, "twice"),
        ({"resampling": "sistematic"}, "sistematic"),
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(settings, word):
    with pytest.raises(ValueError, match=word):
        annealed_filter(problem().model, **{"num_particles": 10, **settings})


def test_layers_disperse_by_the_transitions_own_variance():
    """From 20,000 pairs of draws, whatever states they start from; times the factor of the layer."""
    model, number = linear_gaussian(2, Q=[[0.3, 0.0], [0.0, 2.0]]).compile(), 20_000
    predict = predict_by_transition(model, number, None)
    keys = jax.random.split(jax.random.key(0), 4)
    previous = 30.0 * jax.random.normal(keys[2], (number, 2))
    disperse = jax.jit(lambda keys, previous: predict(keys, previous, None)[1](keys[0], jnp.zeros((number, 2)), 0.25))
    found = np.asarray(disperse((keys[0], keys[1]), previous))
    # a mean of squares of so many pairs, and one of as many draws
    np.testing.assert_allclose(found.var(0), 0.25 * np.array([0.3, 2.0]), rtol=5 * np.sqrt(4 / number))


def test_the_factor_of_the_noise_falls_from_layer_to_layer():
    """Three of four layers disperse, here by a step of the factor itself; ancestors lead back to each start."""
    start = 10.0 * jnp.arange(50.0)[:, None]

    def values(x):
        return -1e-3 * x[:, 0]

    first = _Layer(start, values(start), jnp.arange(50))
    settings = Annealing(4, 0.5, None, systematic)
    last = _refine(jax.random.key(0), first, lambda _, centres, shrinking: centres + shrinking, values, settings)
    np.testing.assert_allclose(last.particles - start[last.ancestors], 0.5 + 0.25 + 0.125, rtol=1e-4)
