"""Two mirror modes that no datum tells apart: a filter must carry both, each with half of the draws."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.mirror import LEVEL, mirror

from poseppl.filters import assumed_density_filter, mode_chains
from poseppl.kernels import HMCSettings
from poseppl.particles.resampling import multinomial

NUM_FRAMES, NUM_CHAINS, NUM_SEEDS = 40, 30, 40


def shares(num_components):
    """Share of the draws above 0 after all frames, one for each seed; that of the exact posterior is a half."""
    model = mirror().compile()
    observations = model.observe({"y": np.full(NUM_FRAMES, LEVEL), "side": np.full(NUM_FRAMES, np.nan)})
    settings = HMCSettings(num_updates=8, num_leapfrog=4, burn_in=2, step_size=0.5, target_rejection=None)
    built = assumed_density_filter(model, NUM_CHAINS, settings, num_components=num_components, num_starts=20)

    def run(key):
        state, _ = built.init(key, jax.tree.map(lambda leaf: leaf[0], observations))

        def step(state, row):
            return built.step(row[0], state, row[1])[0], None

        rest = jax.tree.map(lambda leaf: leaf[1:], observations)
        state, _ = jax.lax.scan(step, state, (jax.random.split(key, NUM_FRAMES - 1), rest))
        return jnp.mean(state.particles > 0)

    return np.asarray(jax.jit(jax.vmap(run))(jax.random.split(jax.random.key(0), NUM_SEEDS)), float)


def test_both_modes_are_carried():
    found = shares(3)
    assert abs(found.mean() - 0.5) < 5 * found.std(ddof=1) / NUM_SEEDS**0.5
    assert ((found > 0.05) & (found < 0.95)).all()


def test_chains_that_choose_modes_by_lot_lose_one(monkeypatch):
    """Independent choices drift: of a share p, a frame's variance p (1 - p) / M adds up until one mode is left."""
    monkeypatch.setattr(mode_chains, "systematic", multinomial)
    found = shares(3)
    assert ((found < 0.05) | (found > 0.95)).mean() > 0.5
