"""Quantiles of many columns at once, by a sorting network.

XLA sorts a column at a time by calls of a comparison; a bitonic network (Batcher 1968) compares whole rows at once, which the
compiler vectorises: 6 times faster for 600 draws of 113 columns on a CPU, and 8 times for 2,000
(``python -m benchmarks.quantiles``). Its stages are a loop over one of them, for each on its own takes its time to compile.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import Array


def column_quantiles(sample: Array, levels: Array) -> Array:
    """Quantiles (levels, ...) of a sample (N, ...), interpolated between its order statistics; NaN where one is NaN."""
    ordered = sort_rows(sample.reshape(sample.shape[0], -1))
    return _between(lambda rank: ordered[rank], levels, sample, sample.shape[0])


def repeated_quantiles(values: Array, counts: Array, number: int, levels: Array) -> Array:
    """Quantiles of a sample with repetitions, as :func:`column_quantiles` of it, but that each value is sorted once.

    Args:
        values: The different members (N, ...).
        counts: How often each is in the sample (N,), int32.
        number: Size of the sample, the sum of the counts.
        levels: Levels of the quantiles (Q,).

    Returns:
        (Q, ...).
    """
    flat = values.reshape(values.shape[0], -1)
    ordered, repeats = _sort_pairs(flat, jnp.broadcast_to(counts[:, None], flat.shape))
    upto = jnp.cumsum(repeats, 0)
    missing = jnp.any(jnp.isnan(flat) & (counts[:, None] > 0), 0)

    def at(rank: Array) -> Array:
        index = jnp.sum(upto <= rank[:, None, None], 1)
        return jnp.where(missing, jnp.nan, jnp.take_along_axis(ordered, index, 0))

    return _between(at, levels, values, number)


def _between(at: Callable[[Array], Array], levels: Array, sample: Array, number: int) -> Array:
    """Quantiles (Q, ...) between the order statistics of a sample of a size, which `at` finds (Q, k) by their ranks (Q,)."""
    place = levels * (number - 1)
    below = jnp.floor(place).astype(jnp.int32)
    above = jnp.minimum(below + 1, number - 1)
    fraction = (place - below).astype(sample.dtype)[:, None]
    between = at(below) * (1 - fraction) + at(above) * fraction
    return between.reshape(len(levels), *sample.shape[1:])


def _sort_pairs(values: Array, others: Array) -> tuple[Array, Array]:
    """Sort each column of a matrix (N, k), and a matrix of whole numbers along with it; with more rows, of infinity and 0."""
    number, columns = values.shape
    size = 1 << (number - 1).bit_length()
    values = jnp.concatenate([values, jnp.full((size - number, columns), jnp.inf, values.dtype)])
    others = jnp.concatenate([others, jnp.zeros((size - number, columns), others.dtype)])
    rows = jnp.arange(size, dtype=jnp.int32)

    def exchange(pairs: tuple[Array, Array], bits: Array) -> tuple[tuple[Array, Array], None]:
        partner = rows ^ bits
        mine, its = pairs[0], pairs[0][partner]
        swapped = jnp.where((rows < partner)[:, None], its < mine, its > mine)
        return (jnp.where(swapped, its, mine), jnp.where(swapped, pairs[1][partner], pairs[1])), None

    return jax.lax.scan(exchange, (values, others), jnp.asarray(_exchanges(size), jnp.int32))[0]


def sort_rows(values: Array) -> Array:
    """Sort each column of a matrix (N, k)."""
    number, columns = values.shape
    size = 1 << (number - 1).bit_length()
    values = jnp.concatenate([values, jnp.full((size - number, columns), jnp.inf, values.dtype)])
    rows = jnp.arange(size, dtype=jnp.int32)

    def exchange(values: Array, bits: Array) -> tuple[Array, None]:
        others = rows ^ bits
        beside = values[others]
        first = (rows < others)[:, None]
        return jnp.where(first, jnp.minimum(values, beside), jnp.maximum(values, beside)), None

    return jax.lax.scan(exchange, values, jnp.asarray(_exchanges(size), jnp.int32))[0][:number]


def _exchanges(size: int) -> list[int]:
    """In which bits the numbers of two rows differ that are compared, stage by stage, for a power of 2 rows."""
    stages, block = [], 2
    while block <= size:
        # two ascending halves, the second one upside down, make one ascending block
        stages.append(block - 1)
        stages += [block >> k for k in range(2, block.bit_length())]
        block *= 2
    return stages
