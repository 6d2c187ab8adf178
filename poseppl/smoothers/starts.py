"""Trajectories drawn from a filter's history: where the smoothers that run Markov chains start.

Backward simulation (Godsill, Doucet and West 2004, doi:10.1198/016214504000000151): a particle of the last frame by its weight,
then at each frame before it one by

    w_t^i p(x_(t+1) | x_t^i),

which joins what belongs together, whatever filter left the particles, and keeps the modes that the filter had. From a frame
with many particles, a few hundred are drawn first, by their weights: a start need not be exact.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.resampling import systematic
from poseppl.program import CompiledModel
from poseppl.smoothers.backward_pass import Earlier, backward_pass, log_backward
from poseppl.smoothers.base import History

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
