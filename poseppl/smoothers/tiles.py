r"""Transition densities between two sets of particles, a tile of rows at a time.

The matrix K_ji = p(x_t^j | x_(t-1)^i) of N x N entries is never stored as a whole. Rows j, the later particles, are processed
in tiles, so that memory grows with N and not with N^2. Each row of a tile may be multiplied by a factor of its own without
changing the result; the factor keeps the row within the range of floating point.

Most often exp(log p) is in range without a factor, and a subtraction before the exponential would cost a third of the time. So
a tile is first tried without factors. Its row totals show whether a row overflowed, or became so small that its entries lost
digits. Only then is the tile computed a second time, with each row's largest entry scaled to 1.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import RangeError

ENTRIES = 2**20
"""Entries of a tile: enough to keep two cores busy, few enough for the cache."""


def block_size(tile: int | None, num_rows: int, num_columns: int) -> int:
    """Rows of a tile: as asked, or about 2^20 entries, in tiles of equal size.

    Raises:
        RangeError: A tile below 1.
    """
    check_tile(tile)
    largest = max(1, min(num_rows, tile or max(1, ENTRIES // num_columns)))
    return -(-num_rows // -(-num_rows // largest))


def check_tile(tile: int | None) -> None:
    """Refuse tiles without a row.

    Raises:
        RangeError: A tile below 1.
    """
    if tile is not None and tile < 1:
        raise RangeError("tile", tile, "at least 1 row of the matrix at a time, or None")


def split_rows(array: Array, rows: int) -> Array:
    """Turn (M, ...) into (tiles, rows, ...); the last tile is filled up with copies of the first row."""
    missing = -array.shape[0] % rows
    filled = jnp.concatenate([array, jnp.broadcast_to(array[:1], (missing, *array.shape[1:]))])
    return filled.reshape(-1, rows, *array.shape[1:])


def join_rows(tiles: Array, num_rows: int) -> Array:
    """Undo `split_rows`."""
    return tiles.reshape(-1, *tiles.shape[2:])[:num_rows]


def with_densities(
    log_densities: Callable[[], Array],
    measure: Callable[[Array], Array],
    consume: Callable[[Array, Array], Any],
    needed: Array,
    possible: Array,
) -> tuple[Any, Array]:
    """Give a tile of densities to `consume`, each row scaled by a number of its own where the range makes it necessary.

    Args:
        log_densities: Makes the tile of log-densities (B, N), NaN where a density is not defined (taken as zero). A row that
            is zero in all possible columns says nothing: it is taken as constant.
        measure: `densities (B, N) -> sums`, (B,) or (B, ...), the sums by which rows are divided.
        consume: `(densities, sums) -> result`, which does not depend on the scales of the rows; those not needed may have
            sums of 0.
        needed: Which rows matter (B,).
        possible: Which columns have weight at all (N,); the largest entry is sought among them.

    Returns:
        The result, and which of the needed rows are zero in all possible columns (B,).
    """

    def scaled() -> tuple[Any, Array]:
        logs = log_densities()
        logs = jnp.where(possible & ~jnp.isnan(logs), logs, -jnp.inf)
        peaks = jnp.max(logs, 1, keepdims=True)
        densities = jnp.exp(jnp.where(jnp.isfinite(peaks), logs - peaks, 0.0))
        return consume(densities, measure(densities)), needed & ~jnp.isfinite(peaks[:, 0])

    densities = jnp.exp(log_densities())
    sums = measure(densities)
    totals = jnp.sum(sums.reshape(sums.shape[0], -1), 1)
    limits = np.finfo(totals.dtype)
    kept = jnp.all((totals < limits.max**0.5) & ((totals > limits.tiny**0.5) | ~needed))
    found: tuple[Any, Array] = jax.lax.cond(kept, lambda: (consume(densities, sums), jnp.zeros_like(needed)), scaled)
    return found
