"""Limits of BlackJAX's pieces: if a test fails here, one of our own pieces may be removed."""

from __future__ import annotations

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from blackjax.mcmc import metrics
from blackjax.smc import resampling
from blackjax.smc.ess import ess_solver
from blackjax.smc.solver import dichotomy

from poseppl.filters.tempering import next_increment
from poseppl.particles.resampling import systematic

NUM = 400


def adaptive(log_likelihood, step=None):
    """BlackJAX's adaptive tempered SMC on the line, by random walks or by a step of one's own."""
    walk = blackjax.additive_step_random_walk.build_kernel()

    def by_walk(key, state, log_density):
        return walk(key, state, log_density, blackjax.mcmc.random_walk.normal(jnp.asarray(0.5)))

    return blackjax.adaptive_tempered_smc(
        lambda x: -0.5 * x**2,
        log_likelihood,
        step or by_walk,
        blackjax.additive_step_random_walk.init,
        {},
        resampling.systematic,
        0.5,
        num_mcmc_steps=3,
    )


@pytest.fixture(scope="module")
def course():
    """Temperatures, weights and particles of the steps until the temperature is 1."""
    sampler = adaptive(lambda x: -0.5 * (x - 2.0) ** 2 / 0.05**2)
    state, states, step = sampler.init(jax.random.normal(jax.random.key(0), (NUM,))), [], jax.jit(sampler.step)
    while state.tempering_param < 1:
        state, _ = step(jax.random.key(len(states)), state)
        states.append(state)
    return states


def test_a_mass_matrix_that_is_a_scalar_is_refused():
    """So that moves give a vector of ones."""
    with pytest.raises(ValueError, match="ndim|dimension|expected 1 or 2"):
        metrics.default_metric(jnp.asarray(1.0))


def test_particles_move_at_the_temperature_before():
    """A step leaves in each particle the temperature that it moved at: of the last particles it is not 1."""

    def mark(key, state, log_density):
        at_one = log_density(jnp.ones(())) + 0.5
        return state._replace(position=at_one), blackjax.mcmc.random_walk.RWInfo(1.0, True, state)

    sampler = adaptive(lambda x: x, mark)
    start = sampler.init(jax.random.normal(jax.random.key(0), (NUM,)))._replace(tempering_param=jnp.asarray(0.4))
    after, _ = jax.jit(sampler.step)(jax.random.key(1), start)
    assert after.tempering_param > 0.4
    np.testing.assert_allclose(after.particles, 0.4, rtol=1e-5)


def test_the_effective_number_is_not_the_one_asked_for(course):
    """The temperature is chosen by particles that then move."""
    had = np.array([1 / np.sum(np.asarray(state.weights) ** 2) / NUM for state in course[:-1]])
    assert np.abs(had - 0.5).max() > 0.02


def test_the_temperature_stays_where_half_of_the_particles_are_impossible():
    """Half of the weight is lost at any temperature: with 0.6 asked, BlackJAX's solver takes none, ours a share of the rest."""
    values = jnp.where(jnp.arange(NUM) % 2 == 0, -jnp.inf, -3.0 * jnp.linspace(0.0, 1.0, NUM) ** 2)
    assert ess_solver(lambda x: x, values, 0.6, 1.0, dichotomy) < 1e-6
    assert next_increment(values, 0.6, jnp.asarray(1.0)) == 1.0


def test_weights_are_no_numbers_where_all_particles_are_impossible():
    sampler = adaptive(lambda x: -jnp.inf + 0.0 * x)
    after, _ = jax.jit(sampler.step)(jax.random.key(1), sampler.init(jnp.zeros(NUM)))
    assert np.isnan(after.weights).all() or after.tempering_param == 0


@pytest.mark.full
def test_resampling_in_single_precision_loses_particles():
    """Systematic resampling should take each of a million particles of one weight once."""
    num = 1_000_000
    blackjaxs = resampling.systematic(jax.random.key(3), jnp.full(num, 1 / num, jnp.float32), num)
    assert len(np.unique(blackjaxs)) < num
    assert len(np.unique(systematic(jax.random.key(3), jnp.zeros(num, jnp.float32), num))) == num


@pytest.mark.full
def test_nuts_side_by_side_waits_for_the_longest_trajectory():
    """Densities are evaluated for chains that have ended, too: evaluations are those of the longest, times the chains."""
    calls, kernel, chains = [], blackjax.nuts.build_kernel(), 8

    def log_density(x):
        jax.debug.callback(lambda _: calls.append(1), x)
        return -0.5 * x**2

    def update(key, x):
        return kernel(key, blackjax.nuts.init(x, lambda x: -0.5 * x**2), log_density, 0.3, jnp.ones(1), 6)[1]

    starts = 4.0 * jnp.arange(chains)
    info = jax.jit(jax.vmap(update))(jax.random.split(jax.random.key(0), chains), starts)
    steps = np.asarray(info.num_integration_steps)
    jax.effects_barrier()
    assert steps.max() > steps.min() and len(calls) > 1.2 * steps.sum()
