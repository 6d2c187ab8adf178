"""Chains that start in the modes of a density, each by its mass, and run in coordinates whitened by the modes' curvature."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from poseppl.filters.chains import LogDensity
from poseppl.kernels.hmc import Chains, HMCSettings, hmc_chains
from poseppl.kernels.laplace import Modes, whitening
from poseppl.particles.resampling import systematic

CANDIDATES = 4
"""Draws from which each chain picks its start."""


def chains_from_modes(
    key_start: jax.Array,
    key_chains: jax.Array,
    modes: Modes,
    log_density: LogDensity,
    log_step_size: jax.Array,
    num_chains: int,
    settings: HMCSettings,
) -> tuple[jax.Array, Chains]:
    """Run M chains.

    Args:
        key_start: PRNG key of the starts.
        key_chains: PRNG key of the chains.
        modes: Modes with the masses by which they are chosen.
        log_density: Unnormalised log-density of one state (d,), a scalar.
        log_step_size: Log step size to start from.
        num_chains: M.
        settings: L, R, b and so on.

    Returns:
        The draws as states (M, R - b, d), and the chains, in whitened coordinates.
    """
    starts, chosen = start_chains(key_start, modes, log_density, num_chains)
    chart = whitening(modes.states[jnp.argmax(modes.log_masses)], jnp.mean(modes.precisions[chosen], 0))
    chains = hmc_chains(key_chains, chart.to_white(starts), lambda z: log_density(chart.to_state(z)), log_step_size, settings)
    return chart.to_state(chains.draws), chains


def start_chains(rng_key: jax.Array, modes: Modes, log_density: LogDensity, num_chains: int) -> tuple[jax.Array, jax.Array]:
    """Start M chains (M, d) from modes (M,) chosen by their masses.

    Each chain picks one of a few draws from its mode's Laplace approximation, by importance: where the posterior bends, some of
    them lie so far out that a chain would not come back within the burn-in.
    """
    key_choose, key_noise, key_pick = jax.random.split(rng_key, 3)
    chosen = systematic(key_choose, modes.log_masses, num_chains)
    noise = jax.random.normal(key_noise, (num_chains, CANDIDATES, modes.states.shape[1]), modes.states.dtype)
    candidates = modes.states[chosen][:, None] + jnp.einsum("nij,ncj->nci", modes.scales[chosen], noise)
    importance = jax.vmap(jax.vmap(log_density))(candidates) + 0.5 * jnp.sum(noise**2, -1)
    picked = jax.random.categorical(key_pick, jnp.where(jnp.isnan(importance), -jnp.inf, importance))
    return jnp.take_along_axis(candidates, picked[:, None, None], 1)[:, 0], chosen
