r"""Smoothing by the filter's own genealogy (Kitagawa 1996, doi:10.2307/1390750): each last particle with its ancestors.

With a_t the ancestors of frame t, the trajectory of particle i runs through b_(T-1) = i, b_(t-1) = a_t(b_t), and has the last
frame's weight. It costs nothing and is consistent, but resampling leaves few different ancestors: a hundred frames back,
often one alone. The baseline for other smoothers.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info


@memoized_builder
def genealogy_smoother(model: CompiledModel) -> Smoother:
    """The ancestors of the last frame's particles: the baseline of smoothing.

    Args:
        model: The compiled model; not used, as everything stands in the history.

    Returns:
        The smoother. Its `ess` counts particles that share an ancestor as one. It raises a ValueError for a history whose
        ancestors are no genealogy, as those of filters of chains.
    """

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        check_genealogy(history)
        num_frames, num_particles, _ = history.particles.shape
        last = normalise(history.log_weights[-1])
        indices = lines(history.ancestors, jnp.arange(num_particles, dtype=history.ancestors.dtype))
        particles = jnp.take_along_axis(history.particles, indices[..., None], axis=1)
        ess = jax.vmap(lambda line: shared_ess(last.weights, line))(indices)
        log_weights = jnp.broadcast_to(last.log_weights, indices.shape)
        return Smoothed(particles, log_weights, smoothing_info(num_frames, ess))

    return Smoother(smooth, joint=True, requires_genealogy=True)


def check_genealogy(history: History) -> None:
    """Refuse a history without genealogy.

    Raises:
        ValueError: Ancestors that are not one for each particle.
    """
    if history.ancestors.shape != history.log_weights.shape:
        raise ValueError(
            f"history.ancestors has shape {history.ancestors.shape} and log_weights {history.log_weights.shape}: the filter "
            "keeps no ancestor for each particle. Use the history of a particle filter, or forward_backward_smoother."
        )


def lines(ancestors: Array, last: Array) -> Array:
    """Indices (T, M) through which the lines of `last` (M,) run, from ancestors (T, N) whose first row is not used."""

    def back(line: Array, row: Array) -> tuple[Array, Array]:
        return row[line], row[line]

    _, before = jax.lax.scan(back, last, ancestors[1:], reverse=True)
    return jnp.concatenate([before, last[None]])


def shared_ess(weights: Array, line: Array) -> Array:
    """Effective number of ancestors, a scalar, when particles of weights (N,) descend from those in `line` (N,)."""
    return 1.0 / jnp.sum(jnp.zeros_like(weights).at[line].add(weights) ** 2)
