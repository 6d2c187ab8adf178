"""Particle Gibbs smoothing: a Markov chain of whole trajectories, moved by conditional sequential Monte Carlo.

Each move of :mod:`poseppl.smoothers.conditional_smc` leaves the joint smoothing distribution invariant for any number of
particles; more particles make the chain mix faster, not more exact. It needs no gradient and no Gaussian, and takes discrete
states. Chains start from trajectories drawn from the filter's history (:mod:`poseppl.smoothers.starts`).

Static parameters are learned with it by :func:`poseppl.smoothers.static_parameters.particle_gibbs`.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother
from poseppl.smoothers.conditional_smc import Method, conditional_smc
from poseppl.smoothers.effective import smoothed_chains
from poseppl.smoothers.starts import initial_trajectories


@memoized_builder
def particle_gibbs_smoother(
    model: CompiledModel,
    *,
    num_particles: int = 100,
    num_chains: int = 4,
    num_draws: int = 250,
    num_warmup: int = 25,
    method: Method = "ancestor",
) -> Smoother:
    """Particle Gibbs: conditional particle filters with ancestor sampling or backward simulation.

    Args:
        model: The compiled model.
        num_particles: N of each move, the reference included.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Moves of each chain before them.
        method: "ancestor" sampling or "backward" simulation.

    Returns:
        The smoother; its particles are (T, M, R, d), and the draw of one index is a whole trajectory. `acceptance` is the share
        of the moves that changed a frame's state.

    Raises:
        ValueError: A number out of range, or an unknown method.
    """
    check_at_least(2, num_particles=num_particles)
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_choice(Method, method=method)
    num_moves = num_warmup + num_draws

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_start, key_moves = jax.random.split(rng_key)
        starts = initial_trajectories(model, key_start, history, inputs, num_chains)

        def move(key: Array, xs: Array) -> Array:
            return conditional_smc(model, key, xs, observations, inputs, num_particles, method)

        def advance(xs: Array, key: Array) -> tuple[Array, tuple[Array, Array]]:
            moved = jax.vmap(move)(jax.random.split(key, num_chains), xs)
            return moved, (moved, jnp.mean(jnp.any(moved != xs, -1), 0))

        _, (draws, changed) = jax.lax.scan(advance, starts, jax.random.split(key_moves, num_moves))
        return smoothed_chains(
            jnp.transpose(draws[num_warmup:], (2, 1, 0, 3)),
            acceptance=jnp.mean(changed[num_warmup:], 0),
            num_transition=float(num_moves * num_chains * (starts.shape[1] - 1) * num_particles),
        )

    return Smoother(smooth, joint=True)
