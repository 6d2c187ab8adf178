"""Tempered SMC beyond the laws: evidence and moments by quadrature, the ESS that is asked, impossible and equal particles."""

from __future__ import annotations

from functools import partial

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import frame, problem, replicate, z_scores
from oracles.quadrature import moments_on_grid
from poseppl_models.toys.linear_gaussian import linear_gaussian
from scipy.stats import norm

from poseppl.filters import TemperedState, tempered_filter
from poseppl.filters.tempered import _prior_covariance
from poseppl.filters.tempering import Tempering, next_increment, temper
from poseppl.kernels import HMC_MOVES, RANDOM_WALK_MOVES, CustomKernel
from poseppl.kernels.adapted_chain import unchecked
from poseppl.particles.resampling import systematic

SETTINGS = Tempering(0.5, 30, None, 1, True, HMC_MOVES, systematic)
NUM = 400


def log_prior(x, context=None):
    return -0.5 * jnp.sum(x * x) - jnp.log(2 * jnp.pi)


def log_likelihood(x):
    """A bent ridge, narrow beside the prior."""
    return -0.5 * (x[1] + x[0] ** 2 - 1.5) ** 2 / 0.1**2


def one_run(settings, likelihood, rng_key, prior=log_prior):
    key_draw, key_run = jax.random.split(rng_key)
    particles = jax.random.normal(key_draw, (NUM, 2))
    return temper(key_run, particles, None, prior, likelihood, jnp.eye(2), jnp.log(settings.moves.step_size), settings)


def runs(settings, likelihood=log_likelihood, num=60, prior=log_prior):
    keys = jax.random.split(jax.random.key(1), num)
    return jax.jit(lambda keys: jax.lax.map(lambda k: one_run(settings, likelihood, k, prior), keys))(keys)


@pytest.fixture(scope="module")
def exact():
    axes = (np.linspace(-5, 5, 1001), np.linspace(-6, 6, 1201))

    def log_density(points):
        x, y = points.T
        return -0.5 * (x**2 + y**2) - np.log(2 * np.pi) - 0.5 * (y + x**2 - 1.5) ** 2 / 0.1**2

    return moments_on_grid(log_density, axes)


def scores(found, exact):
    """z-scores of the evidence, the means and the second moments about the exact means."""
    log_evidence, mean, covariance = exact
    draws = np.asarray(found.particles, float)
    centred = draws - mean
    seconds = np.einsum("kni,knj->kij", centred, centred) / NUM
    ratio = np.exp(np.asarray(found.log_evidence, float) - log_evidence)
    return abs(z_scores(ratio, 1.0)), np.abs(z_scores(draws.mean(1), mean)).max(), np.abs(z_scores(seconds, covariance)).max()


NUTS, SLICE = blackjax.nuts.build_kernel(), blackjax.elliptical_slice.build_kernel(jnp.ones(2), jnp.zeros(2))


def nuts(rng_key, state, log_density, step_size):
    return NUTS(unchecked(rng_key), state, log_density, step_size, jnp.ones(2), 4)


def ratio(log_density):
    """To the standard normal density, which elliptical slice sampling wants its target given by."""
    return lambda z: log_density(z) + 0.5 * z @ z


OWN = {
    "mala": CustomKernel(blackjax.mala.init, blackjax.mala.build_kernel()),
    "nuts": CustomKernel(blackjax.nuts.init, nuts),
    "elliptical-slice": CustomKernel(
        lambda z, log_density: blackjax.elliptical_slice.init(z, ratio(log_density)),
        lambda rng_key, state, log_density, step_size: SLICE(rng_key, state, ratio(log_density)),
    ),
}
KINDS = {
    "hmc": SETTINGS,
    "random-walk": SETTINGS._replace(moves=RANDOM_WALK_MOVES),
    "waste-free": SETTINGS._replace(chain_length=5),
    **{name: SETTINGS._replace(moves=HMC_MOVES._replace(own=own, num_moves=4)) for name, own in OWN.items()},
}
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("nuts", "elliptical-slice")]


@pytest.mark.full
@pytest.mark.parametrize("kind", [*(name for name in KINDS if name not in ("nuts", "elliptical-slice")), *SLOW])
def test_evidence_and_moments_are_those_of_quadrature(kind, exact):
    found = runs(KINDS[kind])
    assert max(scores(found, exact)) < 5
    temperatures, ess = np.asarray(found.temperatures), np.asarray(found.ess)
    for k in range(len(ess)):
        steps = int(found.num_temperatures[k])
        assert 3 <= steps < SETTINGS.max_temperatures
        assert (np.diff(temperatures[k, :steps]) > 0).all()
        assert temperatures[k, steps - 1] == 1.0
        # what is asked is what is had, to the precision of one particle's weight in float32
        np.testing.assert_allclose(ess[k, : steps - 1], 0.5 * NUM, rtol=1e-3)
        assert ess[k, steps - 1] >= 0.5 * NUM * (1 - 1e-5)
        assert (ess[k, steps:] == NUM).all() and (temperatures[k, steps:] == 1).all()


@pytest.mark.full
def test_moves_on_another_density_are_noticed(exact):
    """As when the prior's normalised density is left out of the moves."""
    found = runs(SETTINGS, prior=lambda x, context: 0.5 * log_prior(x))
    assert max(scores(found, exact)) > 10


@pytest.mark.full
def test_fixed_temperatures_are_those_given(exact):
    found = runs(SETTINGS._replace(temperatures=(0.02, 0.1, 0.3, 1.0)))
    np.testing.assert_allclose(found.temperatures, np.tile([0.02, 0.1, 0.3, 1.0], (60, 1)), rtol=1e-6)
    assert max(scores(found, exact)) < 5


@pytest.mark.full
def test_partly_impossible_data():
    """Half of the prior has no likelihood: the evidence is half of the rest's, and no draw lies there."""
    found = runs(SETTINGS, lambda x: jnp.where(x[0] > 0, -2.0 * x[1] ** 2, -jnp.inf))
    assert (np.asarray(found.particles)[..., 0] > 0).all()
    assert abs(z_scores(np.exp(np.asarray(found.log_evidence, float)), 0.5 / np.sqrt(5.0))) < 5


@pytest.mark.full
def test_impossible_data_end_at_once():
    one = jax.jit(lambda value: one_run(SETTINGS, lambda x: value + 0.0 * x[0], jax.random.key(0)))
    for value in (-np.inf, np.nan, np.inf):
        found = one(value)
        assert found.failed and found.log_evidence == -np.inf and found.num_temperatures == 0
        assert np.isfinite(found.particles).all()
        np.testing.assert_array_equal(found.ancestors, np.arange(NUM))


@pytest.mark.full
def test_the_last_temperature_allowed_takes_what_is_left():
    found = runs(SETTINGS._replace(max_temperatures=2), num=5)
    assert (found.num_temperatures == 2).all() and (found.temperatures[:, 1] == 1.0).all()
    assert (found.ess[:, 1] < 0.4 * NUM).all()
    assert np.isfinite(found.log_evidence).all()


@pytest.mark.full
@pytest.mark.parametrize(("moves", "num_particles"), [(HMC_MOVES, 1), (RANDOM_WALK_MOVES, 7)], ids=["one", "equal"])
def test_one_particle_and_equal_particles(moves, num_particles):
    posed = problem()
    step = jax.jit(tempered_filter(posed.model, num_particles, moves=moves).step)
    weights = jnp.full(num_particles, -jnp.log(num_particles))
    for value in (0.0, 50.0):
        state = TemperedState(jnp.full((num_particles, 2), value), weights, jnp.zeros(()))
        found = step(jax.random.key(1), state, *posed.at(1))
        assert all(np.isfinite(np.asarray(leaf, float)).all() for leaf in jax.tree.leaves(found))


@pytest.mark.full
def test_learning_from_the_particles_biases_the_evidence_little():
    posed = problem()
    _, _, increments = replicate(tempered_filter(posed.model, 300), posed, 40)
    ratio = np.exp(increments.sum(1) - posed.exact.log_evidence.sum())
    assert abs(z_scores(ratio, 1.0)) < 5
    assert ratio.std() < 0.5


@pytest.mark.slow
def test_precise_data_in_ten_dimensions():
    """With a handful of particles left in the particle filter, the tempered one has the log-evidence to about one."""
    model = linear_gaussian(10, R=0.01 * np.eye(10)).compile()
    observation = model.observe({"y": np.full((1, 10), 1.5)})
    one = frame(observation, 0)
    init = jax.jit(partial(tempered_filter(model, 500).init, inputs=None))
    found = [float(init(jax.random.key(seed), one)[1].log_evidence) for seed in range(10)]
    exact = 10 * (-0.5 * 1.5**2 / 1.01 - 0.5 * np.log(2 * np.pi * 1.01))
    assert abs(np.mean(found) - exact) < 5 * np.std(found, ddof=1) / np.sqrt(10) + 0.2
    assert np.std(found) < 1.5


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"num_particles": 0}, "num_particles"),
        ({"target": "marginal"}, "target"),
        ({"ess_target": 1.0}, "ess_target"),
        ({"max_temperatures": 0}, "max_temperatures"),
        ({"temperatures": (0.5, 0.2, 1.0)}, "temperatures"),
        ({"temperatures": (0.5,)}, "temperatures"),
        ({"temperatures": ()}, "temperatures"),
        ({"chain_length": 3}, "chain_length"),
        ({"resampling": "sistematic"}, "sistematic"),
        ({"moves": HMC_MOVES._replace(kernel="nuts")}, "kernel"),
        ({"moves": HMC_MOVES._replace(num_moves=0)}, "num_moves"),
        ({"moves": HMC_MOVES._replace(step_size=0.0)}, "step_size"),
        ({"moves": HMC_MOVES._replace(target_acceptance=1.0)}, "target_acceptance"),
        ({"moves": HMC_MOVES._replace(jitter=1.0)}, "jitter"),
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(settings, word):
    with pytest.raises(ValueError, match=word):
        tempered_filter(problem().model, **{"num_particles": 100, **settings})


@pytest.mark.full
def test_evidence_is_right_where_coordinates_are_many_and_particles_few():
    """28 standard normal coordinates, half of them seen in small noise: 50 runs of 200 particles, within 4 standard errors."""
    model = linear_gaussian(28, 14, R=0.01 * np.eye(14)).compile()
    filter, y = tempered_filter(model, 200), np.linspace(-1.5, 1.5, 14)
    observation, keys = model.observe({"y": y}), jax.random.split(jax.random.key(0), 50)
    found = np.asarray(jax.jit(partial(jax.lax.map, lambda key: filter.init(key, observation)[1].log_evidence))(keys), float)
    # the logarithm of an unbiased estimate of small spread is too low by half of its variance
    bias, variance = found.mean() - norm(0, np.sqrt(1.01)).logpdf(y).sum(), found.var(ddof=1)
    assert abs(bias + variance / 2) < 4 * np.sqrt(variance / 50 + variance**2 / 100)


@pytest.mark.full
@pytest.mark.parametrize(("step_size", "low", "high"), [(0.5, 100.0, NUM), (0.1, 1.0, 50.0)])
def test_the_effective_number_is_what_means_of_runs_differ_by(step_size, low, high):
    """Moves that draw copies apart, and moves that leave them alike, on the way to data that are ten times as precise."""
    model = linear_gaussian(4, R=0.01 * np.eye(4)).compile()
    moves = HMC_MOVES._replace(step_size=step_size, target_acceptance=None)
    filter, data = tempered_filter(model, NUM, moves=moves), model.observe({"y": np.full((1, 4), 0.5)})
    first, keys = jax.tree.map(lambda leaf: leaf[0], data), jax.random.split(jax.random.key(0), 40)
    state, info = jax.jit(lambda keys: jax.lax.map(lambda key: filter.init(key, first), keys))(keys)
    draws, told = np.asarray(state.particles, float), np.mean(1 / np.asarray(info.ess, float))
    differ = draws.mean(1).var(0, ddof=1).mean() / draws.var(1).mean()
    assert low < 1 / told < high
    # of 160 means: their variance errs by a tenth, the families of a run are few; and temperatures keep half of the weights
    assert 0.5 < told / differ < 2.5


def test_draws_stay_with_the_ancestors_that_they_are_given():
    """Each prior is a narrow Gaussian about its own context; a chain of five states stays with the one where it began."""
    contexts = 10.0 * jnp.arange(NUM)[:, None]

    def prior(x, context):
        return -0.5 * jnp.sum((x - context) ** 2)

    particles = contexts + jax.random.normal(jax.random.key(0), (NUM, 1))
    settings = SETTINGS._replace(chain_length=5)
    found = jax.jit(
        lambda key: temper(
            key, particles, contexts, prior, lambda x: -0.5 * x[0] ** 2 / 1e6, jnp.eye(1), jnp.log(0.1), settings
        )
    )(jax.random.key(1))
    assert np.abs(np.asarray(found.particles - contexts[found.ancestors])).max() < 6
    assert len(np.unique(found.ancestors)) > 10


def test_the_effective_number_that_is_asked_for_is_a_share_of_what_is_possible():
    values = jnp.where(jnp.arange(NUM) % 2 == 0, -jnp.inf, -3.0 * jnp.linspace(0.0, 1.0, NUM) ** 2)
    delta = next_increment(values, 0.6, jnp.asarray(20.0))
    weights = np.where(np.isfinite(values), np.exp(float(delta) * np.asarray(values)), 0.0)
    assert weights.sum() ** 2 / (weights**2).sum() == pytest.approx(0.6 * NUM / 2, rel=1e-3)
    assert next_increment(values, 0.6, jnp.asarray(0.01)) == pytest.approx(0.01)


@pytest.mark.parametrize("given_ancestor", [True, False])
def test_the_scale_of_moves_is_the_covariance_of_the_prior(given_ancestor):
    """20,000 draws about ancestors that are far apart, or about none."""
    root = np.array([[1.0, 0.0], [0.8, 0.5]])
    centres = 50.0 * jax.random.normal(jax.random.key(3), (20_000, 2)) if given_ancestor else jnp.zeros((20_000, 2))

    def draw(seed):
        return centres + jax.random.normal(jax.random.key(seed), centres.shape) @ root.T

    found = _prior_covariance(draw(0), lambda: draw(1), needed=True, given_ancestor=given_ancestor)
    np.testing.assert_allclose(found, root @ root.T, atol=5 * np.sqrt(2 / 20_000))
