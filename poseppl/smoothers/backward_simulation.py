r"""Backward simulation: trajectories drawn from the filter's particles, from the last frame to the first.

Godsill, Doucet and West 2004 (doi:10.1198/016214504000000151). The last state of a trajectory is drawn by the filter's
weights; given its state x_(t+1), particle i of frame t is drawn with probability proportional to

    w_t^i p(x_(t+1) | x_t^i).

* exact: all N probabilities are made, a tile of trajectories at a time: O(N M) a frame.
* metropolis: the index starts at the ancestor of the particle of frame t + 1 and makes `num_moves` Metropolis moves. Each is
  proposed by the weights w_t and accepted with probability min(1, p(x_(t+1) | x_t^new) / p(x_(t+1) | x_t^old)). This costs O(M)
  a frame (Bunch and Godsill 2013, doi:10.1109/TSP.2012.2227480). With a bootstrap filter's ancestors the start is already a
  draw from the right distribution, and one move is enough for trajectories that do not degenerate (Dau and Chopin 2023,
  doi:10.1214/23-AOS2324). Without ancestors (filters of chains) the start is a draw by weight, and more moves are needed.

Proposals come from one systematic resampling for all trajectories, shuffled by a permutation that is drawn once, and turned by
a fresh random number at each move: each trajectory's proposal is a draw by the weights, independent of its past, and all of
them together cover the weights evenly.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_choice
from poseppl.particles.resampling import systematic
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_transition_matrix, log_transitions
from poseppl.smoothers.backward_pass import Earlier, Step, backward_pass
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info
from poseppl.smoothers.tiles import block_size, check_tile, join_rows, split_rows, with_densities

Method = Literal["exact", "metropolis"]


@memoized_builder
def backward_simulation_smoother(
    model: CompiledModel, num_trajectories: int = 500, *, method: Method = "exact", num_moves: int = 1, tile: int | None = None
) -> Smoother:
    """Backward simulation: trajectories drawn through the filter's particles, from the last frame to the first.

    Args:
        model: The compiled model.
        num_trajectories: M, at least 1.
        method: "exact" or "metropolis".
        num_moves: Metropolis moves a frame, at least 1.
        tile: Trajectories whose N probabilities "exact" keeps in memory at a time; None keeps about a million numbers.

    Returns:
        The smoother; its particles are M trajectories of equal weight, and `ess` is the number of different particles that they
        use.

    Raises:
        ValueError: A number below 1 or an unknown method.
    """
    check_tile(tile)
    check_at_least(1, num_trajectories=num_trajectories, num_moves=num_moves)
    check_choice(Method, method=method)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        key_last, key_deal, key_steps = jax.random.split(rng_key, 3)
        deal = jax.random.permutation(key_deal, num_trajectories)
        last = _draw_by_weight(key_last, history.log_weights[-1], deal)
        if method == "exact":
            step: Step = partial(_exact_step, model, tile)
            cost = num_trajectories * history.particles.shape[1]
        else:
            step = partial(_metropolis_step, model, num_moves, deal)
            cost = num_trajectories * (1 + num_moves)
        return trace_back(key_steps, history, inputs, last, step, float(cost))

    return Smoother(smooth, joint=True)


def trace_back(rng_key: Array, history: History, inputs: Any, last: Array, step: Step, cost: float) -> Smoothed:
    """Trajectories from the indices `last` (M,) of the last frame, by `step` from frame to frame.

    Args:
        rng_key: PRNG key.
        history: The filter's history.
        inputs: Inputs of all frames, or None.
        last: Indices (M,) of particles of the last frame.
        step: `(rng_key, chosen (M,), frame) -> (earlier (M,), (acceptance, share of unreachable trajectories))`.
        cost: Transition densities that a step evaluates.
    """
    num_frames = history.particles.shape[0]
    keys = jax.random.split(rng_key, max(num_frames - 1, 1))[: num_frames - 1]
    indices, (acceptance, unreachable) = backward_pass(step, keys, *history[:3], inputs, last)
    trajectories = jnp.take_along_axis(history.particles, indices[..., None], axis=1)
    log_weights = jnp.full(indices.shape, -jnp.log(indices.shape[1]), trajectories.dtype)
    ess = jax.vmap(partial(_effective_number, history.particles.shape[1], trajectories.dtype))(indices)
    info = smoothing_info(
        num_frames,
        ess,
        acceptance=jnp.append(acceptance, 1.0),
        num_transition=(num_frames - 1) * cost,
        unreachable=jnp.append(unreachable, 0.0),
    )
    return Smoothed(trajectories, log_weights, info)


def _draw_by_weight(rng_key: Array, log_weights: Array, deal: Array) -> Array:
    """Indices (M,), each by the weights (N,): a systematic sample in the order of a permutation (M,), turned at random."""
    key_slots, key_turn = jax.random.split(rng_key)
    dealt = systematic(key_slots, log_weights, deal.shape[0])[deal]
    turn = jax.random.randint(key_turn, (), 0, deal.shape[0])
    turned: Array = jax.lax.dynamic_slice(jnp.concatenate([dealt, dealt]), (turn,), deal.shape)
    return turned


def _effective_number(num_particles: int, dtype: Any, indices: Array) -> Array:
    """1 / sum of squared shares of the particles that M trajectories pass through, a scalar in [1, M]."""
    counts = jnp.zeros(num_particles, dtype).at[indices].add(1.0)
    return indices.shape[0] ** 2 / jnp.sum(counts**2)


def _exact_step(model: CompiledModel, tile: int | None, rng_key: Array, chosen: Array, frame: Earlier) -> tuple[Array, Any]:
    """Draw earlier indices (M,) by inversion: first a block of about sqrt(N) particles, then one of it."""
    earlier, log_weights, later, _, inputs = frame
    count, block = earlier.shape[0], max(1, round(earlier.shape[0] ** 0.5))
    columns = split_rows(earlier, block).reshape(-1, earlier.shape[1])
    weights = jnp.zeros(columns.shape[0], log_weights.dtype).at[:count].set(jnp.exp(log_weights))
    rows = block_size(tile, chosen.shape[0], columns.shape[0])
    heights = 1.0 - jax.random.uniform(rng_key, chosen.shape, log_weights.dtype)

    def draw(part: tuple[Array, Array]) -> tuple[Array, Array]:
        xs, heights = part

        def invert(densities: Array, sums: Array) -> Array:
            which, rest = _invert(sums, heights * jnp.sum(sums, 1))
            inside = (densities * weights).reshape(heights.shape[0], -1, block)[jnp.arange(heights.shape[0]), which]
            drawn: Array = which * block + _invert(inside, rest)[0]
            return drawn

        drawn: tuple[Array, Array] = with_densities(
            lambda: log_transition_matrix(model, xs, columns, inputs),
            lambda densities: ((densities * weights).reshape(-1, block) @ jnp.ones(block, weights.dtype)).reshape(rows, -1),
            invert,
            jnp.ones(rows, bool),
            weights > 0,
        )
        return drawn

    tiles = jax.lax.map(draw, (split_rows(later[chosen], rows), split_rows(heights, rows)))
    drawn, unreachable = (join_rows(part, chosen.shape[0]) for part in tiles)
    return drawn.astype(jnp.int32), (jnp.ones((), weights.dtype), jnp.mean(unreachable, dtype=weights.dtype))


def _invert(masses: Array, heights: Array) -> tuple[Array, Array]:
    """For each row of masses (B, n), the first entry whose cumulative sum reaches the height (B,), and what is left there."""
    sums = jnp.cumsum(masses, 1)
    reached = jnp.minimum(heights, sums[:, -1])
    which: Array = jnp.sum(sums < reached[:, None], 1)
    before = jnp.take_along_axis(jnp.pad(sums, ((0, 0), (1, 0))), which[:, None], axis=1)[:, 0]
    return which, reached - before


def _metropolis_step(
    model: CompiledModel, num_moves: int, deal: Array, rng_key: Array, chosen: Array, frame: Earlier
) -> tuple[Array, Any]:
    """Move earlier indices (M,) from the ancestors, or from draws by weight where the ancestors are no genealogy."""
    earlier, log_weights, later, ancestors, inputs = frame
    key_start, key_moves = jax.random.split(rng_key)
    later = later[chosen]

    def log_densities(indices: Array) -> Array:
        return log_transitions(model, later, earlier[indices], inputs)

    def move(state: tuple[Array, Array], key: Array) -> tuple[tuple[Array, Array], Array]:
        indices, values = state
        key_propose, key_accept = jax.random.split(key)
        proposed = _draw_by_weight(key_propose, log_weights, deal)
        proposed_values = log_densities(proposed)
        heights = 1.0 - jax.random.uniform(key_accept, values.shape, values.dtype)
        accepted = jnp.log(heights) < proposed_values - values
        kept = jnp.where(accepted, proposed, indices), jnp.where(accepted, proposed_values, values)
        return kept, jnp.mean(accepted, dtype=values.dtype)

    has_genealogy = ancestors.shape == log_weights.shape
    start = ancestors[chosen] if has_genealogy else _draw_by_weight(key_start, log_weights, deal)
    (indices, values), acceptance = jax.lax.scan(move, (start, log_densities(start)), jax.random.split(key_moves, num_moves))
    unreachable = ~(values > -jnp.inf)
    return indices, (jnp.mean(acceptance), jnp.mean(unreachable, dtype=values.dtype))
