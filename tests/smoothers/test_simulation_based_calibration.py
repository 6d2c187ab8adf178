"""Smoothed trajectories of the growth model are calibrated: the true state ranks uniformly among them.

Simulation-based calibration (Talts, Betancourt, Simpson, Vehtari and Gelman 2018, arXiv:1804.06788). Truth and data come from
the model, L trajectories from filter and smoother; if these are draws from the posterior, the rank of the truth among them is
uniform on 0..L, for single frames and for what joins two of them. Chi-squared over the L + 1 ranks must stay below the quantile
of 1 - 1e-5; filtered draws, and draws pulled towards their mean, go far beyond.
"""

from __future__ import annotations

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from law_problems import independent
from poseppl_models.toys.growth import growth
from scipy.stats import chi2
from smoothing_problems import Smoothing, filtered_history

from poseppl.program import Observation
from poseppl.smoothers import Smoothed, Smoother, backward_simulation_smoother, particle_gibbs_smoother

DRAWS, FRAMES = 15, 6
MODEL = growth().compile(1.0)
TIMES = jnp.arange(1.0, FRAMES + 1)


def of_filter(model):
    """Draws by the filter's weights, frame by frame."""

    def smooth(rng_key, history, observations, inputs):
        keys = jax.random.split(rng_key, FRAMES)
        chosen = jax.vmap(lambda key, weights: jax.random.categorical(key, weights, shape=(DRAWS,)))(keys, history.log_weights)
        particles = jnp.take_along_axis(history.particles, chosen[..., None], axis=1)
        return Smoothed(particles, jnp.zeros((FRAMES, DRAWS)), None)

    return Smoother(smooth, joint=False)


def narrowed(model):
    """Draws pulled towards their mean."""
    exact = backward_simulation_smoother(model, DRAWS)

    def smooth(rng_key, history, observations, inputs):
        smoothed = exact.smooth(rng_key, history, observations, inputs)
        mean = smoothed.particles.mean(1, keepdims=True)
        return smoothed._replace(particles=mean + 0.7 * (smoothed.particles - mean))

    return Smoother(smooth, joint=True)


def thinned_particle_gibbs(model):
    """The last draws of fifteen chains."""
    chains = particle_gibbs_smoother(model, num_chains=DRAWS, num_draws=2)

    def smooth(rng_key, history, observations, inputs):
        smoothed = chains.smooth(rng_key, history, observations, inputs)
        return smoothed._replace(particles=smoothed.particles[:, :, -1])

    return Smoother(smooth, joint=True)


BUILDERS = {
    "exact": lambda model: backward_simulation_smoother(model, DRAWS),
    "metropolis": lambda model: backward_simulation_smoother(model, DRAWS, method="metropolis", num_moves=2),
    "particle-gibbs": thinned_particle_gibbs,
    "filter": of_filter,
    "narrowed": narrowed,
}


def simulate(rng_key):
    """A truth (T, 1) and its data."""
    key_first, key_later, key_data = jax.random.split(rng_key, 3)
    first = MODEL.sample_initial(key_first, TIMES[0])

    def move(x, row):
        x = MODEL.sample_transition(row[0], x, row[1])
        return x, x

    _, rest = jax.lax.scan(move, first, (jax.random.split(key_later, FRAMES - 1), TIMES[1:]))
    truth = jnp.concatenate([first[None], rest])
    values = jax.vmap(MODEL.sample_observation)(jax.random.split(key_data, FRAMES), truth, TIMES)
    return truth, Observation(values, jax.tree.map(lambda value: jnp.ones(value.shape, bool), values))


def quantities(xs):
    """Ranked quantities of trajectories (T, ...): three frames, and two products of neighbours."""
    return jnp.stack([xs[0], xs[2], xs[5], xs[0] * xs[1], xs[3] * xs[4]])


@cache
def ranks(names, num_particles, num_runs):
    """Ranks (runs, quantities) of the truth among the draws of each smoother, all behind the same filter."""
    smoothers = {name: BUILDERS[name](MODEL) for name in names}

    def one(rng_key):
        key_truth, key_filter, key_smooth = jax.random.split(rng_key, 3)
        truth, observations = simulate(key_truth)
        posed = Smoothing(MODEL, observations, TIMES, truth, None)
        history, observations = filtered_history(key_filter, posed, num_particles)
        true = quantities(truth)

        def rank(smoother):
            drawn = smoother.smooth(key_smooth, history, observations, TIMES).particles
            return jnp.sum(quantities(drawn[..., 0]) < true, 1)

        return {name: rank(smoother) for name, smoother in smoothers.items()}

    found = independent(one, num_runs, seed=7)
    return {name: np.asarray(values) for name, values in found.items()}


def excess(ranks_of_one):
    """For each quantity, chi-squared of ranks (runs, quantities) over its largest allowed value."""
    expected = len(ranks_of_one) / (DRAWS + 1)
    counts = np.stack([np.bincount(column, minlength=DRAWS + 1) for column in ranks_of_one.T])
    return ((counts - expected) ** 2 / expected).sum(1) / chi2.isf(1e-5, DRAWS)


QUICK = ("exact", "metropolis", "filter", "narrowed"), 300, 800


@pytest.mark.parametrize("name", ["exact", "metropolis"])
@pytest.mark.slow
def test_ranks_are_uniform(name):
    assert excess(ranks(*QUICK)[name]).max() < 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["filter", "narrowed"])
def test_draws_of_another_distribution_are_noticed(name):
    assert excess(ranks(*QUICK)[name]).max() > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["exact", "metropolis", "particle-gibbs"])
def test_ranks_are_uniform_over_many_runs(name):
    assert excess(ranks((name,), 1000, 4000)[name]).max() < 1
