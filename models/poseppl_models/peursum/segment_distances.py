"""Distances of image points from the sides of parts' outlines, batch last."""

from __future__ import annotations

from functools import reduce

import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.barrier import computed_once

_TINY = 1e-12


def squared_distance(points: Array, corners: Array) -> Array:
    """Squared distance (C, K, N) in px of points (C, K, 2, N or 1) from the nearest side of any part.

    Args:
        points: Image points.
        corners: Outlines (C, P, 4, 2, N), of which the first and the second two are the ends of a side.
    """
    starts, ends = (corners[:, :, end::2].reshape(corners.shape[0], -1, 2, corners.shape[-1]) for end in range(2))
    way = ends - starts
    step = computed_once(way / (jnp.sum(way**2, 2, keepdims=True) + _TINY))
    x, y = points[:, :, 0], points[:, :, 1]

    def from_side(side: int) -> Array:
        dx, dy = x - starts[:, side, None, 0], y - starts[:, side, None, 1]
        along = jnp.clip(dx * step[:, side, None, 0] + dy * step[:, side, None, 1], 0.0, 1.0)
        return (dx - along * way[:, side, None, 0]) ** 2 + (dy - along * way[:, side, None, 1]) ** 2

    return reduce(jnp.minimum, (from_side(side) for side in range(starts.shape[1])))
