"""Silhouettes of bodies as bits: which points of a coarse grid of pixels a body covers, 32 points to a word.

The grid takes every ``stride``-th pixel of every ``stride``-th row, from pixel ``stride // 2`` on. On a row a part covers
everything between the outermost points of its outline and of its rings' ellipses (:mod:`poseppl.motion.geometry.coverage`). So
parts become runs of ones, their union an OR of words, and overlaps with a mask counts of ones. This is the convex hull of a
part up to the corners where edges and rings meet. Words have no gradient;
:func:`poseppl.motion.geometry.coverage.soft_coverage` has one.

>>> mask = np.zeros((1, 4, 40), bool)
>>> mask[0, :, 30:34] = True
>>> count_ones(pack_mask(mask, stride=1)[..., None]).tolist()
[[16]]
"""

from __future__ import annotations

from functools import reduce
from operator import or_

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.batch_last import computed_once
from poseppl.motion.geometry.cameras import Cameras
from poseppl.motion.geometry.coverage import Shapes, limb_corners, project_parts
from poseppl.motion.geometry.flesh import Flesh, PartFrames

_WORD = 32
_LEVEL = 1e-6
_FAR = 1e9


def grid_points(size: int, stride: int) -> np.ndarray:
    """Rows or columns of the pixels that the grid takes of an image of so many."""
    return np.arange(stride // 2, size, stride)


def pack_mask(mask: np.ndarray, stride: int) -> Array:
    """Pack masks (C, H, W), not 0 where set, as words (C, rows, words) of the grid; what lies outside is not set."""
    taken = np.asarray(mask)[:, grid_points(mask.shape[1], stride)][:, :, grid_points(mask.shape[2], stride)] != 0
    words = -(-taken.shape[2] // _WORD)
    padded = np.pad(taken, ((0, 0), (0, 0), (0, words * _WORD - taken.shape[2])))
    bits = padded.reshape(*taken.shape[:2], words, _WORD).astype(np.uint64)
    return jnp.asarray(np.sum(bits << np.arange(_WORD, dtype=np.uint64), -1).astype(np.uint32))


def unpack_bits(bits: np.ndarray, width: int) -> np.ndarray:
    """Words (C, rows, words) as booleans (C, rows, width)."""
    ones = (np.asarray(bits)[..., None] >> np.arange(_WORD, dtype=np.uint32)) & 1
    return ones.reshape(*ones.shape[:2], -1)[:, :, :width].astype(bool)


def body_bits(cameras: Cameras, flesh: Flesh, parts: PartFrames, rows: int, words: int, stride: int) -> Array:
    """Which points of the grid a body covers.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1), px.
        flesh: Sizes of the parts, leaves (P, ..., N or 1).
        parts: Their positions, leaves (P, ..., N).
        rows: Rows of the grid.
        words: Words of a row.
        stride: Pixels between points.

    Returns:
        Words (C, rows, words, N); bits beyond the width of the image may be set.
    """
    corners = limb_corners(cameras, flesh, parts)
    shapes = project_parts(cameras, flesh, parts)
    corners, shapes = computed_once((corners, shapes))
    spans = row_spans(corners, shapes, rows, stride)
    first, end = computed_once(spans)
    return _ones_between(first, end, words)


def row_spans(corners: Array, shapes: Shapes, rows: int, stride: int) -> tuple[Array, Array]:
    """Columns of the grid that each part covers on each row: first and one past the last (C, P, rows, N), int32.

    Args:
        corners: Outlines (C, P, 4, 2, N), px.
        shapes: Shapes of the same parts.
        rows: Rows of the grid.
        stride: Pixels between points.
    """
    y = (stride // 2 + stride * jnp.arange(rows, dtype=corners.dtype))[:, None]
    left = jnp.full((*corners.shape[:2], rows, corners.shape[-1]), _FAR, corners.dtype)
    right = -left
    for side in range(4):
        x, crosses = _crossing(corners[:, :, side, :, None], corners[:, :, (side + 1) % 4, :, None], y)
        left, right = jnp.minimum(left, jnp.where(crosses, x, _FAR)), jnp.maximum(right, jnp.where(crosses, x, -_FAR))
    for ring in range(2):
        middle, half, crosses = _ellipse_row(shapes, ring, y)
        left = jnp.minimum(left, jnp.where(crosses, middle - half, _FAR))
        right = jnp.maximum(right, jnp.where(crosses, middle + half, -_FAR))
    limit = 2.0**20  # an integer that float32 holds, beyond every image
    columns = ((jnp.clip(edge, -limit, limit) - stride // 2) / stride for edge in (left, right))
    first, last = columns
    return jnp.ceil(first).astype(jnp.int32), jnp.floor(last).astype(jnp.int32) + 1


def count_ones(bits: Array) -> Array:
    """Numbers of ones (C, N), int32, of words (C, rows, words, N)."""
    return jnp.sum(jax.lax.population_count(bits).astype(jnp.int32), (1, 2))


def _crossing(start: Array, end: Array, y: Array) -> tuple[Array, Array]:
    """Crossings of sides from ``start`` to ``end`` (C, P, 2, 1, N) with rows y (R, 1): x (C, P, R, N), and which exist."""
    rise = end[:, :, 1] - start[:, :, 1]
    slope = (end[:, :, 0] - start[:, :, 0]) / jnp.where(jnp.abs(rise) < _LEVEL, 1.0, rise)
    crosses = (start[:, :, 1] <= y) != (end[:, :, 1] <= y)
    return start[:, :, 0] + (y - start[:, :, 1]) * slope, crosses


def _ellipse_row(shapes: Shapes, ring: int, y: Array) -> tuple[Array, Array, Array]:
    """Middle and half-width (C, P, R, N) of a ring's ellipse on rows y (R, 1), and whether it reaches them."""
    xx, xy, yy = (shapes.inverses[:, :, ring, i, None] for i in range(3))
    dy = y - shapes.centres[:, :, ring, 1, None]
    ratio, inverse = xy / xx, 1.0 / xx
    square = inverse - dy * dy * (yy * inverse - ratio * ratio)
    return shapes.centres[:, :, ring, 0, None] - ratio * dy, jnp.sqrt(jnp.maximum(square, 0.0)), square > 0


def _ones_between(first: Array, end: Array, words: int) -> Array:
    """Words (C, R, words, N) with ones from ``first`` up to ``end`` (C, P, R, N), the parts joined."""
    full = jnp.uint32(0xFFFFFFFF)

    def ones_from(column: Array, word: int) -> Array:
        return jax.lax.shift_left(full, jnp.clip(column - word * _WORD, 0, _WORD).astype(jnp.uint32))  # by 32: nothing is left

    def joined(word: int) -> Array:
        runs = (ones_from(first[:, part], word) & ~ones_from(end[:, part], word) for part in range(first.shape[1]))
        return reduce(or_, runs)

    return jnp.stack([joined(word) for word in range(words)], 2)
