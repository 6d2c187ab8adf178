r"""Forward-backward smoothing: new weights for the filter's particles.

Doucet, Godsill and Andrieu 2000 (doi:10.1023/A:1008935410038); section 4.2 of Peursum, Venkatesh and West 2010
(doi:10.1007/s11263-009-0205-5), there called FBS. With the filter's particles and weights w_t^i, and the last frame's smoothed
weights equal to the filter's, for t = T - 2, ..., 0

    w_(t|T)^i = w_t^i sum_j w_(t+1|T)^j p(x_(t+1)^j | x_t^i) / sum_k w_t^k p(x_(t+1)^j | x_t^k).

Each step needs the N x N densities p(x_(t+1)^j | x_t^i), which are made a tile of rows at a time; a tile is used twice while
it is in the cache: by K w_t for the denominators and by (w_(t+1|T) / K w_t) K for the sums. Time is O(N^2 T), memory O(N T).

Particles stay where the filter put them: smoothing cannot correct what the filter does not cover. A later particle that can be
reached from no earlier one says nothing about them, and its
weight is shared out as the filter's; `SmoothingInfo.unreachable` is the sum of such weights.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_transition_matrix
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info
from poseppl.smoothers.tiles import block_size, check_tile, split_rows, with_densities


@memoized_builder
def forward_backward_smoother(model: CompiledModel, *, tile: int | None = None, parallel: bool = False) -> Smoother:
    """Forward-backward smoothing (FBS): the filter's particles, weighted again by the frames after them.

    Args:
        model: The compiled model.
        tile: Rows of the N x N matrix that are in memory at a time; None keeps about a million entries.
        parallel: Whether frames are smoothed in parallel, by products of N x N matrices, rather than one after the other: for
            hidden Markov models of few values on a GPU. All matrices are in memory.

    Returns:
        The smoother; its particles are the filter's, and only each frame's marginal is known.

    Raises:
        ValueError: A tile below 1.
    """
    check_tile(tile)

    def reweigh(smoothed: Array, frame: Any) -> tuple[Array, tuple[Array, ...]]:
        """Smoothed weights of one frame (N,) from those of the next."""
        earlier, log_weights, later, inputs = frame
        weights = jnp.exp(log_weights)
        support, unreachable = _support(model, later, smoothed, earlier, weights, inputs, tile)
        updated = normalise(log_weights + jnp.log(support))
        result = jnp.where(updated.degenerate, weights, updated.weights)
        return result, (jnp.where(updated.degenerate, log_weights, updated.log_weights), updated.ess, unreachable)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        num_frames, num_particles, _ = history.particles.shape
        if parallel:
            return _smooth_in_parallel(model, history, inputs)
        last = normalise(history.log_weights[-1])
        later = tree_index((history.particles, inputs), slice(1, None))
        frames = (history.particles[:-1], history.log_weights[:-1], *later)
        _, (log_weights, ess, unreachable) = jax.lax.scan(reweigh, last.weights, frames, reverse=True)
        info = smoothing_info(
            num_frames,
            jnp.append(ess, last.ess),
            num_transition=float(num_frames - 1) * float(num_particles) ** 2,
            unreachable=jnp.append(unreachable, 0.0),
        )
        return Smoothed(history.particles, jnp.concatenate([log_weights, last.log_weights[None]]), info)

    return Smoother(smooth, joint=False, reweighs=True)


def _smooth_in_parallel(model: CompiledModel, history: History, inputs: Any) -> Smoothed:
    """The same, w_(t|T) = S_t w_(t+1|T) with S_t[i, j] = w_t^i p(x_(t+1)^j | x_t^i) / sum_k w_t^k p(x_(t+1)^j | x_t^k).

    Columns of S_t have the sum 1, those of particles that come from no earlier one by the filter's weights.
    """
    num_frames, num_particles, _ = history.particles.shape
    last = normalise(history.log_weights[-1])

    def matrix(earlier: Array, log_weights: Array, later: Array, inputs: Any) -> tuple[Array, Array]:
        terms = log_weights[:, None] + log_transition_matrix(model, later, earlier, inputs).T
        reached = jnp.isfinite(jnp.max(terms, 0))
        return jnp.where(reached, jax.nn.softmax(terms, 0), jnp.exp(log_weights)[:, None]), reached

    later = tree_index((history.particles, inputs), slice(1, None))
    matrices, reached = jax.vmap(matrix)(history.particles[:-1], history.log_weights[:-1], *later)
    products = jax.lax.associative_scan(lambda later, earlier: earlier @ later, matrices, reverse=True)
    smoothed = jnp.concatenate([products @ last.weights, last.weights[None]])
    unreachable = jnp.sum(jnp.where(reached, 0.0, smoothed[1:]), 1)
    info = smoothing_info(
        num_frames,
        1.0 / jnp.sum(smoothed**2, 1),
        num_transition=float(num_frames - 1) * float(num_particles) ** 2,
        unreachable=jnp.append(unreachable, 0.0),
    )
    return Smoothed(history.particles, jnp.log(smoothed), info)


def _support(
    model: CompiledModel,
    later: Array,
    smoothed: Array,
    earlier: Array,
    weights: Array,
    inputs: Any,
    tile: int | None,
) -> tuple[Array, Array]:
    """Weight that each earlier particle (N,) gets from the later ones: sum_j w_(t+1|T)^j K_ji / (K w)_j.

    The second value is the weight of later particles that come from no earlier one.
    """
    num_later, num_earlier = later.shape[0], earlier.shape[0]
    rows = block_size(tile, num_later, num_earlier)

    def add(total: Array, part: tuple[Array, Array]) -> tuple[Array, Array]:
        xs, shares = part

        gained, unreachable = with_densities(
            lambda: log_transition_matrix(model, xs, earlier, inputs),
            lambda densities: densities @ weights,
            lambda densities, sums: jnp.where(sums > 0, shares / sums, 0.0) @ densities,
            shares > 0,
            weights > 0,
        )
        return total + gained, jnp.sum(jnp.where(unreachable, shares, 0.0))

    padded = jnp.concatenate([smoothed, jnp.zeros(-num_later % rows, smoothed.dtype)]).reshape(-1, rows)
    total, unreachable = jax.lax.scan(add, jnp.zeros_like(weights), (split_rows(later, rows), padded))
    return total, jnp.sum(unreachable)
