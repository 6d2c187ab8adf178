"""Chains that start in the modes of a density, each by its mass, and run in coordinates whitened by the modes' curvature."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.filters.chains import LogDensity
from poseppl.kernels.hmc import Chains, HMCSettings, hmc_chains
from poseppl.kernels.laplace import Modes, group_masses, group_modes, whitening
from poseppl.particles.keys import normals_and_uniforms, weighted_choice
from poseppl.particles.resampling import systematic
from poseppl.particles.weights import nan_to_neg_inf

MODE_POWER = 0.75
"""Chains are shared among modes in proportion to this power of their masses: a lesser mode gets more than its share."""

CANDIDATES = 4
"""Draws from which each chain picks its start."""


class ModeChains(NamedTuple):
    """Chains that started in modes.

    Attributes:
        draws: Draws as states (M, R - b, d).
        log_weights: Log-weight of each chain (M,), normalised: those that started in one mode share its mass.
        chains: The chains in whitened coordinates.
    """

    draws: Array
    log_weights: Array
    chains: Chains


def chains_from_modes(
    rng_key: Array,
    modes: Modes,
    log_density: LogDensity,
    log_step_size: Array,
    num_chains: int,
    settings: HMCSettings,
    power: float = MODE_POWER,
) -> ModeChains:
    """Run M chains.

    Args:
        rng_key: PRNG key.
        modes: Modes with the masses by which they are chosen.
        log_density: Unnormalised log-density of one state (d,), a scalar.
        log_step_size: Log step size to start from.
        num_chains: M.
        settings: L, R, b and so on.
        power: Exponent of the modes' masses; chains are shared among modes in proportion to the result.
    """
    key_choose, key_start, key_chains = jax.random.split(rng_key, 3)
    chosen, log_weights = allocate_chains(key_choose, modes, num_chains, power)
    starts = start_chains(key_start, modes, chosen, log_density)
    transform = whitening(modes.states[jnp.argmax(modes.log_masses)], jnp.mean(modes.precisions[chosen], 0))
    chains = hmc_chains(
        key_chains, transform.to_white(starts), lambda z: log_density(transform.to_state(z)), log_step_size, settings
    )
    return ModeChains(transform.to_state(chains.draws), log_weights, chains)


def allocate_chains(rng_key: Array, modes: Modes, num_chains: int, power: float = MODE_POWER) -> tuple[Array, Array]:
    """Choose the mode of each chain (M,), and the chains' log-weights (M,).

    Chains are allocated to modes by a power (below one) of the masses, with the smallest possible variance. A chain's weight is
    the mass of its mode over the number of chains there. So a mode's weight is its mass, whatever its number of chains, and
    does not drift from frame to frame, as the shares of chains would.
    """
    labels = group_modes(modes)
    masses = group_masses(modes, labels)
    evened = modes.log_masses - (1.0 - power) * masses
    chosen = systematic(rng_key, evened, num_chains)
    own = labels[chosen]
    weights = masses[chosen] - jnp.log(jnp.sum(own[:, None] == own, 1))
    # where no mode has any mass, all chains count alike
    return chosen, jax.nn.log_softmax(jnp.where(jnp.isfinite(weights), weights, 0.0))


def start_chains(rng_key: Array, modes: Modes, chosen: Array, log_density: LogDensity) -> Array:
    """Starts (M, d) of chains in their chosen modes (M,).

    Each chain picks one of a few draws from its mode's Laplace approximation, by importance: where the posterior bends, some of
    them lie so far out that a chain would not come back within the warm-up.
    """
    dimension, dtype = modes.states.shape[1], modes.states.dtype
    noise, chances = normals_and_uniforms(rng_key, (len(chosen),), CANDIDATES * dimension, 1, dtype)
    noise = noise.reshape(len(chosen), CANDIDATES, dimension)
    candidates = modes.states[chosen][:, None] + jnp.einsum("nij,ncj->nci", modes.scales[chosen], noise)
    importance = jax.vmap(jax.vmap(log_density))(candidates) + 0.5 * jnp.sum(noise**2, -1)
    picked = weighted_choice(chances[:, 0], nan_to_neg_inf(importance))
    return jnp.take_along_axis(candidates, picked[:, None, None], 1)[:, 0]
