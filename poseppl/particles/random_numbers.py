"""Normal and uniform random numbers from one call of the generator.

Each call of `jax.random` adds the generator's code to a program again, which takes long to compile: numbers that are wanted
together are drawn together.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array


def normals_and_uniforms(
    rng_key: Array, shape: tuple[int, ...], num_normals: int, num_uniforms: int, dtype: Any
) -> tuple[Array, Array]:
    """Standard normal numbers (*shape, num_normals), and uniform ones in [0, 1) of shape (*shape, num_uniforms)."""
    # what jax.random.normal does, of whose uniform numbers in (-1, 1) some stay
    smallest = np.nextafter(np.array(-1.0, dtype), np.array(0.0, dtype))
    numbers = jax.random.uniform(rng_key, (*shape, num_normals + num_uniforms), dtype, smallest, 1.0)
    normals = jax.lax.erf_inv(numbers[..., :num_normals]) * np.array(np.sqrt(2), dtype)
    return normals, 0.5 * (numbers[..., num_normals:] + 1.0)


def weighted_choice(uniforms: Array, log_weights: Array) -> Array:
    """Indices (...) of weights (..., K), each drawn in proportion, from uniform numbers in [0, 1) (...); K is small.

    An index of zero weight is never drawn, unless there is no other.
    """
    weights = jax.nn.softmax(log_weights, -1)
    ends = jnp.sum(jnp.where(np.tri(weights.shape[-1], dtype=bool), weights[..., None, :], 0.0), -1)
    return jnp.sum(uniforms[..., None] * ends[..., -1:] >= ends[..., :-1], -1)
