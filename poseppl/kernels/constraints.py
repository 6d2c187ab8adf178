"""Linear constraints on a state: bounds of its coordinates, and rows of a matrix, C x <= c."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

_SWEEPS = 30
"""Rounds of projections that make a start feasible."""


class Constraints(NamedTuple):
    """Constraints of a state (d,): lower <= x <= upper and rows @ x <= limits.

    Attributes:
        lower: Shape (d,), -inf where nothing bounds a coordinate.
        upper: Shape (d,), inf where nothing bounds it.
        rows: Shape (m, d), m >= 0.
        limits: Shape (m,).
    """

    lower: Array
    upper: Array
    rows: Array
    limits: Array

    def normals(self, x: Array) -> Array:
        """Outward normals (d + m, d): of the bound of each coordinate that a state (d,) is nearer to, and of the rows."""
        at_upper = self.upper - x < x - self.lower
        return jnp.concatenate([jnp.diag(jnp.where(at_upper, 1.0, -1.0).astype(x.dtype)), self.rows])

    def slacks(self, x: Array) -> Array:
        """Distances (d + m,) of a state (d,) from the nearer bounds, and from the rows in their own units; negative beyond."""
        return jnp.concatenate([jnp.minimum(x - self.lower, self.upper - x), self.limits - self.rows @ x])

    def row_tolerance(self, x: Array) -> Array:
        """Slacks of the rows (m,) that count as none: what rounding makes of them."""
        size = jnp.abs(self.rows) @ jnp.abs(x) + jnp.abs(self.limits)
        return float(32 * np.finfo(x.dtype).eps) * size

    def project(self, x: Array) -> Array:
        """A state (d,) that keeps to the bounds, and to the rows as far as cyclic projections go: a start of a search."""
        if not self.rows.shape[0]:
            return jnp.clip(x, self.lower, self.upper)

        def onto(x: Array, row: tuple[Array, Array]) -> tuple[Array, None]:
            normal, limit = row
            excess = jnp.maximum(normal @ x - limit, 0.0)
            # a little beyond the face, or rounding leaves the last of it
            step = excess * (1.0 + 1e-3) / jnp.maximum(normal @ normal, np.finfo(x.dtype).tiny)
            return jnp.clip(x - step * normal, self.lower, self.upper), None

        def sweep(_: Any, x: Array) -> Array:
            return jax.lax.scan(onto, x, (self.rows, self.limits))[0]

        projected: Array = jax.lax.fori_loop(0, _SWEEPS, sweep, jnp.clip(x, self.lower, self.upper))
        return projected


def constraints(dimension: int, *, lower: Any = None, upper: Any = None, rows: Any = None, limits: Any = None) -> Constraints:
    """Lay out constraints, of which each may be left out.

    Args:
        dimension: d.
        lower: Lower bounds, broadcast to (d,).
        upper: Upper bounds, broadcast to (d,).
        rows: C (m, d).
        limits: c, broadcast to (m,); 0 by default.

    Raises:
        ValueError: Rows of another length than d.
    """
    dtype = jnp.result_type(float)
    matrix = jnp.zeros((0, dimension), dtype) if rows is None else jnp.asarray(rows, dtype)
    if matrix.ndim != 2 or matrix.shape[1] != dimension:
        raise ValueError(f"rows have shape {matrix.shape}. Expected (m, {dimension}).")
    return Constraints(
        jnp.broadcast_to(jnp.asarray(-jnp.inf if lower is None else lower, dtype), (dimension,)),
        jnp.broadcast_to(jnp.asarray(jnp.inf if upper is None else upper, dtype), (dimension,)),
        matrix,
        jnp.broadcast_to(jnp.asarray(0.0 if limits is None else limits, dtype), matrix.shape[:1]),
    )
