"""Predictions of a filter's history for each frame, before that frame's data: moments, and the density itself.

For a history of weighted particles (x_j, w_j) at the frame before,

    p(x_t | z_(<t)) = sum_j w_j p(x_t | x_j),
    m = sum_j w_j E[x_t | x_j],      P = cov_j E[x_t | x_j] + sum_j w_j Cov[x_t | x_j],

and the initial program's at the first frame. It is valid for any filter, whatever its particles of the frame itself were drawn
from.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import prepend, split_first, tree_index
from poseppl.particles.weights import normalise, weighted_covariance, weighted_mean
from poseppl.program import CompiledModel
from poseppl.program.population import log_initials, log_transition_matrix, transition_moments
from poseppl.smoothers.base import History

_ELEMENTS = 2**24
"""Numbers that a batch of frames may keep at once."""


def map_frames(function: Any, arguments: Any, num_frames: int, elements: int) -> Any:
    """Apply a function of one frame to all, in batches of frames whose largest array, of `elements` a frame, fits in memory."""
    batch = max(1, min(num_frames, _ELEMENTS // max(elements, 1)))
    if batch == num_frames:
        return jax.vmap(function)(arguments)
    blocks = -(-num_frames // batch)
    rows = jnp.minimum(jnp.arange(blocks * batch), num_frames - 1).reshape(blocks, batch)
    mapped = jax.lax.map(lambda row: jax.vmap(function)(tree_index(arguments, row)), rows)
    return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:num_frames], mapped)


def predicted_moments(model: CompiledModel, history: History, inputs: Any) -> tuple[Array, Array]:
    """Mean (T, d) and covariance (T, d, d) of the prediction of every frame.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        history: The filter's.
        inputs: Stacked inputs with leading T, or None.

    Raises:
        ValueError: The programs have no Gaussian moments.
    """
    num_frames, num_particles, dimension = history.particles.shape
    first, later = split_first(inputs)
    mean, covariance = model.initial_moments(first)

    def predict(row: Any) -> tuple[Array, Array]:
        particles, log_weights, row_inputs = row
        means, covariances = transition_moments(model, particles, row_inputs)
        noise = jnp.tensordot(normalise(log_weights).weights, covariances, 1)
        return weighted_mean(means, log_weights), weighted_covariance(means, log_weights) + noise

    if num_frames == 1:
        return mean[None], covariance[None]
    rows = history.particles[:-1], history.log_weights[:-1], later
    means, covariances = map_frames(predict, rows, num_frames - 1, num_particles * dimension**2)
    return prepend((mean, covariance), (means, covariances))


def log_predicted(rng_key: Array, model: CompiledModel, history: History, inputs: Any, num_predecessors: int) -> Array:
    """Log-density (T, N) of every particle under the prediction of its frame, from a sample of the particles before.

    Args:
        rng_key: For the sample.
        model: The compiled model.
        history: The filter's.
        inputs: Stacked inputs with leading T, or None.
        num_predecessors: J, particles of the frame before, resampled by their weights.
    """
    num_frames, num_particles, _ = history.particles.shape
    first, later = split_first(inputs)
    start = log_initials(model, history.particles[0], first)
    if num_frames == 1:
        return start[None]
    size = min(num_predecessors, num_particles)

    def density(row: Any) -> Array:
        key, particles, before, log_weights, row_inputs = row
        chosen = before[systematic(key, log_weights, size)]
        return jax.nn.logsumexp(log_transition_matrix(model, particles, chosen, row_inputs), axis=1) - jnp.log(size)

    keys = jax.random.split(rng_key, num_frames - 1)
    rows = keys, history.particles[1:], history.particles[:-1], history.log_weights[:-1], later
    return jnp.concatenate([start[None], map_frames(density, rows, num_frames - 1, num_particles * size)])
