"""Keys and random numbers for a set of particles, where random bits are what a filter spends its time on.

`jax.vmap` over `jax.random.split(rng_key, N)` hashes twice for each number: once for the particle's key, once for its number.
The keys here belong to a generator (JAX's own Threefry) that knows about batches. A key is three words: a key that all
particles share, and the particle's number. Under `jax.vmap` the bits of all N particles are drawn at once from the shared
key, so that N normals cost no more than `jax.random.normal(rng_key, (N,))`; a key on its own, as in a loop over particles,
draws from the shared key folded with its number. Programs see ordinary scalar keys, may split them and draw anything, and
particles are independent.

A batch draws from its first key alone. A function that is vmapped once more, over replicates, draws in each of them what it
draws from that replicate's key without `vmap`.

Each call of `jax.random` adds the generator's code to a program again, which takes long to compile: numbers that are wanted
together are drawn together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.extend.random
import jax.numpy as jnp
import numpy as np
from jax import Array

_WORDS = 3
_SPREAD = 0x9E3779B9
"""An odd number that spreads the numbers of particles over a word of the key."""


def particle_keys(rng_key: Array, num: int) -> Array:
    """Keys (num,) for functions of one particle under `jax.vmap`; see the module."""
    shared = jnp.broadcast_to(jax.random.bits(rng_key, (2,), jnp.uint32), (num, 2))
    data = jnp.concatenate([shared, jnp.arange(num, dtype=jnp.uint32)[:, None]], 1)
    keys: Array = jax.random.wrap_key_data(data, impl=_GENERATOR)
    return keys


def _shared(data: Array) -> Array:
    key: Array = jax.random.wrap_key_data(data[:2], impl="threefry2x32")
    return key


def _with_number(shared: Array, number: Array) -> Array:
    """Key data (..., 3) of shared keys (...) and one particle's number."""
    data = jax.random.key_data(shared)
    return jnp.concatenate([data, jnp.broadcast_to(number, (*data.shape[:-1], 1))], -1)


def _random_bits(data: Array, bit_width: int, shape: Sequence[int]) -> Array:
    dtype = jnp.dtype(f"uint{bit_width}")

    @jax.custom_batching.custom_vmap
    def draw(data: Array) -> Array:
        return jax.random.bits(jax.random.fold_in(_shared(data), data[2]), tuple(shape), dtype)

    @draw.def_vmap
    def _batch(size: int, is_batched: Any, data: Array) -> tuple[Array, bool]:
        return _bits_of_batch(data[0], dtype, (size, *shape)), True

    bits: Array = draw(data)
    return bits


def _bits_of_batch(data: Array, dtype: Any, shape: tuple[int, ...]) -> Array:
    """Bits of all particles from the key of the first, whose number is 0 unless they are parts of one particle."""
    words = jnp.stack([data[0], data[1] ^ (data[2] * jnp.uint32(_SPREAD))])
    if dtype != jnp.uint32:
        return jax.random.bits(_shared(words), shape, dtype)
    # both words of each block of the cipher, of which JAX's own, which can be sharded, adds up one
    numbers = jax.lax.iota(jnp.uint32, math.prod(shape))
    bits: Array = jax.extend.random.threefry_2x32(words, numbers)
    return bits.reshape(shape)


def _split(data: Array, shape: Sequence[int]) -> Array:
    return _with_number(jax.random.split(_shared(data), tuple(shape)), data[2:])


def _fold_in(data: Array, number: Any) -> Array:
    return _with_number(jax.random.fold_in(_shared(data), number), data[2:])


def _seed(seed: Any) -> Array:
    return _with_number(jax.random.key(seed, impl="threefry2x32"), jnp.zeros(1, jnp.uint32))


_GENERATOR = jax.extend.random.define_prng_impl(
    key_shape=(_WORDS,),
    seed=_seed,
    split=_split,
    random_bits=_random_bits,
    fold_in=_fold_in,
    name="threefry of all particles",
    tag="tfp",
)


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
