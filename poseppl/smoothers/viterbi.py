r"""The most probable trajectory through a filter's particles (Godsill, Doucet and West 2001, doi:10.1023/A:1017968404964).

Viterbi's algorithm on the trellis of particles. With delta the log-density of the best path that ends in a particle,

    delta_0(j) = log p(x_0^j) + log p(z_0 | x_0^j),
    delta_t(j) = log p(z_t | x_t^j) + max_i [delta_(t-1)(i) + log p(x_t^j | x_(t-1)^i)],

and the path is read backwards from the best last particle. Only the particles' places matter, not their weights. The N x N
densities of a frame are made a tile of rows at a time: time O(N^2 T), memory O(N T). The path approximates the mode of
p(x_0..T-1 | z_0..T-1) among N^T combinations; it is one trajectory and says nothing about its uncertainty.

Data that no particle can explain are left out, as the filter does, and so is a transition that no pair of particles can make.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.stacks import split_first
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_initials, log_likelihoods, log_transition_matrix
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info
from poseppl.smoothers.tiles import block_size, check_tile, join_rows, split_rows


@memoized_builder
def viterbi_smoother(model: CompiledModel, *, tile: int | None = None) -> Smoother:
    """The most probable path through the filter's particles.

    Args:
        model: The compiled model.
        tile: Rows of the N x N matrix that are in memory at a time; None keeps about a million entries.

    Returns:
        The smoother; its result is one trajectory, (T, 1, d).

    Raises:
        ValueError: A tile below 1.
    """
    check_tile(tile)

    def log_observations(particles: Array, observation: Observation, inputs: Any) -> Array:
        return _usable(log_likelihoods(model, particles, observation, inputs))

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        particles = history.particles
        num_frames, num_particles, _ = particles.shape
        seen = jax.vmap(log_observations)(particles, observations, inputs)
        first, later = split_first(inputs)
        start = _usable(log_initials(model, particles[0], first)) + seen[0]
        frames = (particles[:-1], particles[1:], seen[1:], later)
        best, (bests, unreachable) = jax.lax.scan(partial(_forward, model, tile), _levelled(start), frames)
        last = jnp.argmax(best)
        # the search for a predecessor costs several times a maximum: it is made for the particles of the path alone
        _, path = jax.lax.scan(partial(_predecessor, model), last, (bests, frames), reverse=True)
        trajectory = jnp.take_along_axis(particles, jnp.append(path, last)[:, None, None], axis=1)
        cost = float(num_frames - 1) * float(num_particles) ** 2
        info = smoothing_info(num_frames, jnp.ones(()), num_transition=cost, unreachable=jnp.append(unreachable, False))
        return Smoothed(trajectory, jnp.zeros((num_frames, 1), trajectory.dtype), info)

    return Smoother(smooth, joint=True, closed_form=True, is_optimizer=True)


def _forward(model: CompiledModel, tile: int | None, best: Array, frame: Any) -> tuple[Array, Any]:
    """Log-densities delta (N,) of one frame from that of the frame before; these (N,), and whether no path goes on."""
    earlier, later, seen, inputs = frame
    rows = block_size(tile, later.shape[0], earlier.shape[0])

    heights = jax.lax.map(lambda xs: jnp.max(_paths(model, xs, earlier, best, inputs), 1), split_rows(later, rows))
    reached = join_rows(heights, later.shape[0])
    return _levelled(_usable(reached) + seen), (best, ~jnp.any(jnp.isfinite(reached)))


def _predecessor(model: CompiledModel, index: Array, row: tuple[Array, Any]) -> tuple[Array, Array]:
    """The best predecessor of the particle of an index."""
    best, (earlier, later, _, inputs) = row
    found = jnp.argmax(_paths(model, later[index][None], earlier, best, inputs)[0])
    return found, found


def _paths(model: CompiledModel, xs: Array, earlier: Array, best: Array, inputs: Any) -> Array:
    """Log-densities (n, N) of the best paths to states (n, d) through each earlier one (N, d)."""
    return nan_to_neg_inf(log_transition_matrix(model, xs, earlier, inputs) + best)


def _usable(log_densities: Array) -> Array:
    """Log-densities (N,) with NaN as -inf; all zero when none is finite, as if the factor did not exist."""
    clean = jnp.where(jnp.isfinite(log_densities), log_densities, -jnp.inf)
    return jnp.where(jnp.any(jnp.isfinite(clean)), clean, 0.0)


def _levelled(best: Array) -> Array:
    """Log-densities (N,) with their maximum at 0, so that long sequences keep their digits; all 0 where no path is possible."""
    usable = _usable(best)
    return usable - jnp.max(usable)
