"""The backward pass through a filter's history, in indices of particles, and trajectories drawn from it as starts.

A step draws, for the particles chosen at frame t + 1, particles of frame t. Backward simulation (Godsill, Doucet and West
2004, doi:10.1198/016214504000000151) draws a particle of the last frame by its weight. At each frame before it, particle i is
drawn with probability proportional to w_t^i p(x_(t+1) | x_t^i). This joins what belongs together, whatever filter left the
particles, and keeps the modes that the filter had. From a frame with many particles, a few hundred are drawn first, by their
weights: a start need not be exact.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel
from poseppl.program.population import log_transitions_into
from poseppl.smoothers.base import History


class Earlier(NamedTuple):
    """A frame that a step draws from, and the next one.

    Attributes:
        particles: Shape (N, d).
        log_weights: Shape (N,).
        later: Particles of the next frame (N, d).
        ancestors: Those of the next frame.
        inputs: Those of the next frame.
    """

    particles: Array
    log_weights: Array
    later: Array
    ancestors: Array
    inputs: Any


Step = Callable[[Array, Array, Earlier], tuple[Array, Any]]
"""`(key, chosen, frame) -> (earlier, anything)`, indices of any shape."""


def backward_pass(
    step: Step,
    keys: Array,
    particles: Array,
    log_weights: Array,
    ancestors: Array,
    inputs: Any,
    last: Array,
) -> tuple[Array, Any]:
    """Go back from the particles `last` of the last frame.

    Args:
        step: From frame to frame.
        keys: PRNG keys (T - 1,), or numbers that the step folds into a key of its own.
        particles: Shape (T, N, d).
        log_weights: Shape (T, N).
        ancestors: Shape (T, ...); those of the first frame are not read.
        inputs: Inputs with a leading T, or None.
        last: Indices of any shape.

    Returns:
        Indices (T, ...), and what else the steps returned, stacked (T - 1, ...).
    """
    later = tree_index((particles, ancestors, inputs), slice(1, None))
    frames = Earlier(particles[:-1], log_weights[:-1], *later)

    def back(chosen: Array, row: tuple[Array, Earlier]) -> tuple[Array, Any]:
        earlier, outputs = step(row[0], chosen, row[1])
        return earlier, (earlier, outputs)

    _, (earlier, outputs) = jax.lax.scan(back, last, (keys, frames), reverse=True)
    return jnp.concatenate([earlier, last[None]]), outputs


def log_backward(model: CompiledModel, x: Array, particles: Array, log_weights: Array, inputs: Any) -> tuple[Array, Array]:
    """Unnormalised log-probabilities (N,) that a state (d,) comes from each particle, and whether there is any."""
    log_transition = log_transitions_into(model, x, particles, inputs)
    joint = log_weights + nan_to_neg_inf(log_transition)
    return joint, jnp.any(joint > -jnp.inf)


_MAX = 512
"""Particles of a frame that are looked at."""


def initial_trajectories(model: CompiledModel, rng_key: Array, history: History, inputs: Any, num: int) -> Array:
    """Draw trajectories (num, T, d).

    Args:
        model: The compiled model.
        rng_key: PRNG key.
        history: The filter's history.
        inputs: Inputs with a leading T, or None.
        num: How many.
    """
    key_thin, key_last, key_back = jax.random.split(rng_key, 3)
    particles, log_weights = _thin(key_thin, history)
    last = jax.random.categorical(key_last, log_weights[-1], shape=(num,))
    numbers = jnp.arange(particles.shape[0] - 1)

    def step(number: Array, chosen: Array, frame: Earlier) -> tuple[Array, None]:
        def join(x: Array) -> Array:
            joint, possible = log_backward(model, x, frame.particles, frame.log_weights, frame.inputs)
            return jnp.where(possible, joint, frame.log_weights)

        return jax.random.categorical(jax.random.fold_in(key_back, number), jax.vmap(join)(frame.later[chosen])), None

    indices, _ = backward_pass(step, numbers, particles, log_weights, history.ancestors, inputs, last)
    return jnp.swapaxes(jnp.take_along_axis(particles, indices[..., None], axis=1), 0, 1)


def _thin(rng_key: Array, history: History) -> tuple[Array, Array]:
    """At most a few hundred particles a frame, with their log-weights."""
    num_frames, num_particles, _ = history.particles.shape
    if num_particles <= _MAX:
        return history.particles, history.log_weights
    keys = jax.random.split(rng_key, num_frames)
    kept = jax.vmap(lambda key, weights: systematic(key, weights, _MAX))(keys, history.log_weights)
    chosen = jnp.take_along_axis(history.particles, kept[:, :, None], 1)
    return chosen, jnp.zeros((num_frames, _MAX), history.log_weights.dtype)
