"""Running sums and maxima of long vectors.

XLA's own cumulative operations are log-depth trees, which take twice as long on a CPU as a loop over blocks: a vector of R
blocks of L entries is turned on its side, and one loop of L steps runs all R blocks at once. Elsewhere, and for short vectors,
XLA's are used. Both add up in short chains: the error in float32 grows like L + log R roundings, not like the length.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp

BLOCK = 512
"""Entries in a block: 256 to 512 are fastest at 100,000."""

Operation = Callable[[jax.Array, jax.Array], jax.Array]


def running_sum(x: jax.Array) -> jax.Array:
    """Sums of the first 1, 2, ..., N entries of x (N,), in its dtype."""
    return _running(x, jnp.add, partial(jnp.cumsum, dtype=x.dtype))


def running_maximum(x: jax.Array) -> jax.Array:
    """Maxima of the first 1, 2, ..., N entries of x (N,), none of which is negative."""
    return _running(x, jnp.maximum, jax.lax.cummax)


def _running(x: jax.Array, operation: Operation, direct: Callable[[jax.Array], jax.Array]) -> jax.Array:
    if x.shape[0] <= 8 * BLOCK:
        return direct(x)
    result: jax.Array = jax.lax.platform_dependent(x, cpu=partial(_in_blocks, operation, direct), default=direct)
    return result


def _in_blocks(operation: Operation, direct: Callable[[jax.Array], jax.Array], x: jax.Array) -> jax.Array:
    rows = -(-x.shape[0] // BLOCK)
    columns = jnp.pad(x, (0, rows * BLOCK - x.shape[0])).reshape(rows, BLOCK).T

    def advance(carry: jax.Array, column: jax.Array) -> tuple[jax.Array, jax.Array]:
        carry = operation(carry, column)
        return carry, carry

    totals, within = jax.lax.scan(advance, jnp.zeros_like(columns[0]), columns)
    before = jnp.concatenate([jnp.zeros(1, x.dtype), direct(totals)[:-1]])
    return operation(within, before).T.reshape(-1)[: x.shape[0]]
