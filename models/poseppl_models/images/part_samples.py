"""Sample points on the parts of bodies in images, and what image maps say there.

A part gets fixed fractions of its outline's quadrilateral (:mod:`poseppl.motion.geometry.coverage`): points along its two
sides, and the centres of a grid of cells inside. Maps say "no evidence" by a negative value, and for all that lies outside of
the image; such samples count neither in sums nor in numbers. :func:`nearest` takes the nearest pixel, :func:`bilinear`
interpolates and has a gradient.

>>> maps = pad_maps(jnp.array([[[0.0, 1.0], [-1.0, 1.0]]]))
>>> value, seen = bilinear(maps, jnp.array([[[0.5], [0.0]]]), jnp.array([[[0.0], [0.5]]]))
>>> value[0, :, 0].tolist(), seen[0, :, 0].tolist()
([0.5, 0.0], [1.0, 0.5])
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

_MIN_LENGTH = 1e-6


class Found(NamedTuple):
    """Values of a map at samples, 0 where there is no evidence, and how much of each sample is evidence: both (C, ..., N)."""

    value: Array
    seen: Array


def pad_maps(maps: Array) -> Array:
    """Maps (C, H, W) with one more row (C, H + 1, W), which says "no evidence" for all that lies outside."""
    return jnp.pad(maps, ((0, 0), (0, 1), (0, 0)), constant_values=-1.0)


def side_points(corners: Array, count: int) -> tuple[Array, Array]:
    """Points x and y (C, P, 2, count, N) at the middles of equal pieces of both sides of outlines (C, P, 4, 2, N)."""
    along = ((jnp.arange(count, dtype=corners.dtype) + 0.5) / count)[:, None]
    starts, ends = corners[:, :, 0::2, :, None], corners[:, :, 1::2, :, None]
    points = starts + along * (ends - starts)
    return points[:, :, :, 0], points[:, :, :, 1]


def side_lengths(corners: Array) -> Array:
    """Lengths (C, P, 2, N) of both sides, px."""
    sides = corners[:, :, 1::2] - corners[:, :, 0::2]
    return jnp.sqrt(jnp.sum(sides**2, 3) + _MIN_LENGTH**2)


def inside_points(corners: Array, rows: int, columns: int) -> tuple[Array, Array]:
    """Points x and y (C, P, rows * columns, N) at the centres of a grid of cells, rows along the axis and columns across."""
    down, right = ((jnp.arange(number, dtype=corners.dtype) + 0.5) / number for number in (rows, columns))
    first, other = (
        corners[:, :, start, :, None] + down[:, None] * (corners[:, :, end] - corners[:, :, start])[:, :, :, None]
        for start, end in ((0, 1), (3, 2))
    )
    points = first[:, :, :, :, None] + right[:, None] * (other - first)[:, :, :, :, None]
    flat = points.reshape(*points.shape[:3], -1, points.shape[-1])
    return flat[:, :, 0], flat[:, :, 1]


def areas(corners: Array) -> Array:
    """Areas (C, P, N) of the quadrilaterals, px."""
    one, other = corners[:, :, 2] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 1]
    return jnp.abs(one[:, :, 0] * other[:, :, 1] - one[:, :, 1] * other[:, :, 0]) / 2


def nearest(maps: Array, x: Array, y: Array) -> Found:
    """Look up padded maps (C, H + 1, W) at the pixels nearest to points (C, ..., N), without a gradient."""
    found = _take(maps, _places(maps, x, y))
    return Found(jnp.maximum(found, 0.0), (found >= 0).astype(x.dtype))


def bilinear(maps: Array, x: Array, y: Array) -> Found:
    """Interpolate padded maps (C, H + 1, W) at points (C, ..., N), between the four pixels around each.

    Pixels without evidence are left out: the value and ``seen`` are sums of the others, by their shares.
    """
    left, top = jax.lax.stop_gradient((jnp.floor(x), jnp.floor(y)))
    right_share, lower_share = x - left, y - top
    value, seen = jnp.zeros_like(x), jnp.zeros_like(x)
    for across, share in ((0, 1 - right_share), (1, right_share)):
        for down, other in ((0, 1 - lower_share), (1, lower_share)):
            found = _take(maps, _places(maps, left + across, top + down))
            weight = share * other
            value, seen = value + weight * jnp.maximum(found, 0.0), seen + weight * (found >= 0)
    return Found(value, seen)


def index_at(maps: Array, x: Array, y: Array) -> Array:
    """Look up whole numbers in padded maps (C, H + 1, W) at the pixels nearest to points (C, ..., N)."""
    return _take(maps, _places(maps, x, y))


def weighted_mean(found: Found, weights: Array, empty: float) -> Array:
    """Mean (C, N) over samples (C, ..., N) that count by ``weights``, which broadcast to them; ``empty`` where none is seen."""
    axes = tuple(range(1, found.value.ndim - 1))
    total, number = jnp.sum(found.value * weights, axes), jnp.sum(found.seen * weights, axes)
    return jnp.where(number > 0, total / jnp.where(number > 0, number, 1.0), empty)


def _places(maps: Array, x: Array, y: Array) -> Array:
    """Places of the nearest pixels in each camera's flat map; those outside are in the padding row.

    A loop over cameras keeps them apart from the look-up: were both one loop, the compiler would not vectorise the arithmetic.
    """
    height, width = maps.shape[1] - 1, maps.shape[2]

    def place(point: tuple[Array, Array]) -> Array:
        column, row = point
        inside = (column >= -0.5) & (column < width - 0.5) & (row >= -0.5) & (row < height - 0.5)
        columns, rows = ((jnp.where(inside, axis, 0.0) + 0.5).astype(jnp.int32) for axis in (column, row))
        return jnp.where(inside, rows * width + columns, height * width)

    places: Array = jax.lax.map(place, (jax.lax.stop_gradient(x), jax.lax.stop_gradient(y)))
    return places


def _take(maps: Array, places: Array) -> Array:
    first = jnp.arange(maps.shape[0], dtype=jnp.int32).reshape(-1, *(1,) * (places.ndim - 1)) * (maps.shape[1] * maps.shape[2])
    return jnp.take(maps.reshape(-1), first + places, mode="clip")
