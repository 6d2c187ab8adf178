"""Bounds of the coordinates of a state."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array


class Constraints(NamedTuple):
    """What a state (d,) has to keep to: lower <= x <= upper.

    Attributes:
        lower: Shape (d,), -inf where nothing bounds a coordinate.
        upper: Shape (d,), inf where nothing bounds it.
    """

    lower: Array
    upper: Array

    def normals(self, x: Array) -> Array:
        """Outward normals (d, d) of the bound of each coordinate that a state (d,) is nearer to."""
        at_upper = self.upper - x < x - self.lower
        return jnp.diag(jnp.where(at_upper, 1.0, -1.0).astype(x.dtype))

    def slacks(self, x: Array) -> Array:
        """Distances (d,) of a state (d,) from the nearer bounds; negative beyond."""
        return jnp.minimum(x - self.lower, self.upper - x)


def constraints(dimension: int, *, lower: Any = None, upper: Any = None) -> Constraints:
    """Lay out constraints, of which each may be left out.

    Args:
        dimension: d.
        lower: Lower bounds, broadcast to (d,).
        upper: Upper bounds, broadcast to (d,).
    """
    given = (-jnp.inf if lower is None else lower, jnp.inf if upper is None else upper)
    return Constraints(*(jnp.broadcast_to(jnp.asarray(bound, float), (dimension,)) for bound in given))
