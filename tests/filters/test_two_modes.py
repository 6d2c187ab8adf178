"""Two mirror modes that no datum tells apart: a filter must carry both, each with half of the weight."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.toys.mirror import LEVEL, mirror

from poseppl.filters import assumed_density_filter, mode_chains
from poseppl.kernels import HMCSettings
from poseppl.kernels.laplace import Modes, group_masses, group_modes

NUM_FRAMES, NUM_CHAINS, NUM_SEEDS = 40, 30, 40


def shares(num_components):
    """Share of the draws above 0 after all frames, one for each seed; that of the exact posterior is a half."""
    model = mirror().compile()
    observations = model.observe({"y": np.full(NUM_FRAMES, LEVEL), "side": np.full(NUM_FRAMES, np.nan)})
    settings = HMCSettings(num_updates=8, num_leapfrog=4, num_warmup=2, step_size=0.5, target_acceptance=None)
    built = assumed_density_filter(model, NUM_CHAINS, settings, num_components=num_components, num_starts=20)

    def run(key):
        state, _ = built.init(key, jax.tree.map(lambda leaf: leaf[0], observations))

        def step(state, row):
            return built.step(row[0], state, row[1])[0], None

        rest = jax.tree.map(lambda leaf: leaf[1:], observations)
        state, _ = jax.lax.scan(step, state, (jax.random.split(key, NUM_FRAMES - 1), rest))
        return jnp.sum(jax.nn.softmax(state.log_weights, (0, 1)) * (state.particles[..., 0] > 0))

    return np.asarray(jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(0), NUM_SEEDS)), float)


@pytest.mark.slow
def test_both_modes_are_carried():
    found = shares(3)
    assert abs(found.mean() - 0.5) < 5 * found.std(ddof=1) / NUM_SEEDS**0.5
    assert (np.abs(found - 0.5) < 0.2).all() and found.std() < 0.06


@pytest.mark.slow
def test_weights_by_numbers_of_chains_drift(monkeypatch):
    """With a mode's mass in the number of its chains alone, which are whole, shares wander from frame to frame."""

    def by_number(rng_key, modes, num_chains, power):
        chosen = jax.random.categorical(rng_key, modes.log_masses, shape=(num_chains,))
        return chosen, jnp.full(num_chains, -jnp.log(num_chains))

    monkeypatch.setattr(mode_chains, "allocate_chains", by_number)
    found = shares(3)
    assert ((found < 0.05) | (found > 0.95)).mean() > 0.5


def laplace(states, log_masses, width=1.0):
    states = jnp.asarray(states, jnp.float32)[:, None]
    scales = jnp.full((len(states), 1, 1), width)
    return Modes(states, 1.0 / scales**2, scales, jnp.asarray(log_masses, jnp.float32))


@pytest.mark.full
def test_modes_linked_by_steps_are_one():
    modes = laplace([0.0, 2.0, 10.0, 4.0, jnp.nan], [*np.log([0.1, 0.2, 0.3, 0.4]), -np.inf])
    labels = group_modes(modes)
    assert labels.tolist() == [0, 0, 2, 0, 4]
    np.testing.assert_allclose(np.exp(group_masses(modes, labels)), [0.7, 0.7, 0.3, 0.7, 0.0], rtol=1e-5)


@pytest.mark.parametrize("lesser", [0.5, 0.1, 0.02])
def test_a_mode_weighs_its_mass_however_many_chains_it_got(lesser):
    modes = laplace([-10.0, 10.0, 10.5], np.log([1 - lesser, lesser / 2, lesser / 2]))
    chosen, log_weights = mode_chains.allocate_chains(jax.random.key(0), modes, 30)
    assert np.exp(log_weights)[np.asarray(chosen) > 0].sum() == pytest.approx(lesser, rel=1e-5)
    assert (chosen > 0).sum() >= max(1, np.floor(30 * lesser))
    assert np.exp(log_weights).sum() == pytest.approx(1.0, rel=1e-5)


@pytest.mark.full
@pytest.mark.parametrize(("power", "expected"), [(1.0, 0.1), (0.75, 0.1614), (0.5, 0.25), (0.0, 0.5)])
def test_a_smaller_power_gives_a_lesser_mode_more_chains_and_the_same_weight(power, expected):
    """Masses 0.1 and 0.9: shares of 0.1^a / (0.1^a + 0.9^a), to within a chain; without the power all would have the first."""
    modes = laplace([-10.0, 10.0], np.log([0.9, 0.1]))
    chosen, log_weights = mode_chains.allocate_chains(jax.random.key(0), modes, 1000, power)
    assert abs((chosen == 1).sum() / 1000 - expected) < 2e-3
    assert np.exp(log_weights)[np.asarray(chosen) == 1].sum() == pytest.approx(0.1, rel=1e-5)


@pytest.mark.full
def test_where_no_mode_has_mass_all_chains_count_alike():
    chosen, log_weights = mode_chains.allocate_chains(jax.random.key(0), laplace([-10.0, 10.0, 10.5], [-np.inf] * 3), 30)
    assert set(chosen.tolist()) == {0, 1, 2}
    np.testing.assert_allclose(np.exp(log_weights), 1 / 30, rtol=1e-5)
