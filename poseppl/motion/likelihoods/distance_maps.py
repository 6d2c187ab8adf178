"""Values of maps between their pixels, batch last."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array


def at_points(maps: Array, scale: Array, x: Array, y: Array) -> Array:
    """Bilinear values (C, ..., N) of maps at image points; beyond the border, those at the border.

    Args:
        maps: Shape (C, H, W, 1).
        scale: Pixels of the maps to one of the image (C, 1): centres of pixels are at whole numbers in both.
        x: Columns of points (C, ..., N), px of the image.
        y: Their rows.
    """
    count, height, width = maps.shape[:3]
    spread = scale.reshape(-1, *(1,) * (x.ndim - 1))
    x, y = jnp.clip((x + 0.5) * spread - 0.5, 0.0, width - 1.001), jnp.clip((y + 0.5) * spread - 0.5, 0.0, height - 1.001)
    column, row = jnp.floor(x), jnp.floor(y)
    right, down = x - column, y - row
    first = jnp.arange(count, dtype=jnp.int32).reshape(-1, *(1,) * (x.ndim - 1)) * (height * width)
    place = first + (row * width + column).astype(jnp.int32)
    flat = maps.reshape(-1)
    above, below = ([jnp.take(flat, place + shift + step, mode="clip") for step in (0, 1)] for shift in (0, width))
    upper, lower = (pair[0] + right * (pair[1] - pair[0]) for pair in (above, below))
    return upper + down * (lower - upper)
