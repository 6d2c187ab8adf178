"""Running sums of long vectors of integers, exact and fast.

XLA's own cumulative operations are log-depth trees, which a CPU runs slowly. Here a vector is cut into rows of 16, each row
times a triangular matrix of ones is its running sum, and the rows' totals are summed in the same way: the work is one thin
matrix product, at the speed of reading and writing. Few totals are summed at once, each from all before it, for each level
takes its time to compile.

The numbers are integers stored as floats, so sums are exact below 2^24 in float32. Longer numbers come in two parts, a whole
one and a fraction in units of 2^-20 (2^-49 in float64), and each level carries from the second into the first: sums keep 20
bits after the point at any length, and entries of zero change nothing, to the last bit.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

_ROW, _FEW = 16, 32


class Split(NamedTuple):
    """Numbers in two parts of one shape: integers, and integer multiples of the :func:`unit`."""

    whole: Array
    fraction: Array


def unit(dtype: np.dtype[Any]) -> float:
    """Value of a fraction of 1: the largest power of 2 of which sums of a row are exact, inverted."""
    return float(2.0 ** -_bits(dtype))


def _bits(dtype: np.dtype[Any]) -> int:
    """Digits of a fraction, after the point."""
    return int(np.finfo(dtype).nmant) - 3


def split_number(x: Array) -> Split:
    """Split numbers into the nearest integer and the rest."""
    whole = jnp.round(x)
    return Split(whole, jnp.round((x - whole) / unit(x.dtype)))


def largest_sum(dtype: np.dtype[Any]) -> int:
    """Up to where sums are exact."""
    return int(2 ** (np.finfo(dtype).nmant + 1))


def running_sum(x: Array) -> Array:
    """Sums of the first 1, 2, ..., N of integers (N,) stored as floats."""
    if x.shape[0] <= _FEW:
        return _at_once(x)
    rows = _rows(x)
    within = _product(rows)
    before = _shifted(running_sum(within[:, -1]))
    return (within + before[:, None]).reshape(-1)[: x.shape[0]]


def running_split_sum(x: Split) -> Split:
    """Running sums of split numbers; fractions of the sums lie in [0, 1)."""
    if x.whole.shape[0] <= _FEW:
        # so many fractions have sums of more bits than a float's
        whole, fraction = _at_once(jnp.stack([x.whole, x.fraction]).astype(int))
        over = fraction >> _bits(x.whole.dtype)
        rest = fraction - (over << _bits(x.whole.dtype))
        return Split((whole + over).astype(x.whole.dtype), rest.astype(x.whole.dtype))
    within = _carry(*_product(jnp.stack([_rows(x.whole), _rows(x.fraction)])))
    totals = running_split_sum(Split(within.whole[:, -1], within.fraction[:, -1]))
    whole = within.whole + _shifted(totals.whole)[:, None]
    fraction = within.fraction + _shifted(totals.fraction)[:, None]
    size = x.whole.shape[0]
    return _carry(whole.reshape(-1)[:size], fraction.reshape(-1)[:size])


def _at_once(x: Array) -> Array:
    """Running sums along the last axis, each on its own."""
    return jnp.sum(jnp.where(np.tri(x.shape[-1], dtype=bool), x[..., None, :], 0), -1)


def _rows(x: Array) -> Array:
    rows = -(-x.shape[0] // _ROW)
    return jnp.pad(x, (0, rows * _ROW - x.shape[0])).reshape(rows, _ROW)


def _product(rows: Array) -> Array:
    triangle = jnp.asarray(np.triu(np.ones((_ROW, _ROW))), rows.dtype)
    return jnp.matmul(rows, triangle, precision=jax.lax.Precision.HIGHEST)


def _shifted(totals: Array) -> Array:
    return jnp.concatenate([jnp.zeros(1, totals.dtype), totals[:-1]])


def _carry(whole: Array, fraction: Array) -> Split:
    step = unit(fraction.dtype)
    over = jnp.floor(fraction * step)
    return Split(whole + over, fraction - over / step)
