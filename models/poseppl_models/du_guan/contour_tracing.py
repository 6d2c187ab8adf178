"""Outer contours of many silhouettes at once, traced along the borders of grid points, and their Fourier descriptors.

A silhouette is given as words of bits (:mod:`poseppl_models.images.silhouette_bits`). The contour starts at the first point
that is set, row by row. It follows the border between points that are set and points that are not, with the silhouette on its
right; points that touch at a corner are connected (Rosenfeld and Kak 1982, *Digital Picture Processing*, section 11.1). A
corner is kept at regular intervals of steps. All silhouettes take their steps together, so that a step costs two look-ups of a
silhouette.

Descriptors are those of :func:`poseppl.motion.vision.fourier_descriptors`, |Z_k| / |Z_1| for k = -1, 2, -2, 3, ..., but with
the exact integrals over the polygon: with chords of direction u_j from arc length s_j to s_j+1 of the whole length L,

    Z_k = L / (2 pi k)^2 sum over j of u_j (exp(-2 pi i k s_j+1 / L) - exp(-2 pi i k s_j / L)).

Only the piece is seen that holds the first point: a limb that the picture's border or a thin place cuts off is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.barrier import computed_once

_STEPS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""East, south, west, north, rows counted downwards: turning right adds one."""
_AHEAD_RIGHT = np.array([[0, 0], [-1, 0], [-1, -1], [0, -1]])
_AHEAD_LEFT = np.array([[0, -1], [0, 0], [-1, 0], [-1, -1]])
"""Cells beside the way ahead of a corner, whose own cell lies below it and to the right."""
_TINY = 1e-12

_Harmonic = tuple[Array, Array, Array, Array, Array, Array]
"""For a k the real and imaginary part of exp(-2 pi i k s / L) at the last corner, and four sums over the chords so far."""


class Contours(NamedTuple):
    """Polygons of M silhouettes: corners ``x`` and ``y`` (K, M), the last repeated to fill up, and whether each closed (M,)."""

    x: Array
    y: Array
    closed: Array


def trace_contours(bits: Array, max_corners: int = 256, every: int = 4) -> Contours:
    """Trace the outer contours of silhouettes.

    Args:
        bits: Words (rows, words, M).
        max_corners: Room for corners K; a contour of more than ``max_corners * every`` steps is cut short and not closed.
        every: Steps between corners that are kept.

    Returns:
        The corners in units of the grid; those of an empty silhouette are all the same.
    """
    start_x, start_y = _first_point(bits)
    count = bits.shape[2]
    table = bits.reshape(-1, count)
    empty = ~jnp.any(bits != 0, (0, 1))

    def is_set(x: Array, y: Array) -> Array:
        inside = (x >= 0) & (x < bits.shape[1] * 32) & (y >= 0) & (y < bits.shape[0])
        word = jnp.where(inside, y * bits.shape[1] + (x >> 5), 0)
        found = jnp.take_along_axis(table, word[None], 0, mode="clip")[0]
        return inside & ((found >> (x & 31).astype(jnp.uint32)) & 1).astype(bool)

    def step(walk: tuple[Array, ...]) -> tuple[Array, ...]:
        x, y, heading, done = walk
        way = _chosen(_STEPS, heading)
        x, y = jnp.where(done, x, x + way[0]), jnp.where(done, y, y + way[1])
        (right_x, right_y), (left_x, left_y) = _chosen(_AHEAD_RIGHT, heading), _chosen(_AHEAD_LEFT, heading)
        left, right = is_set(x + left_x, y + left_y), is_set(x + right_x, y + right_y)
        turn = jnp.where(left, 3, jnp.where(right, 0, 1))
        return x, y, (heading + turn) & 3, done | ((x == start_x) & (y == start_y))

    def piece(carry: tuple[Array, ...]) -> tuple[Array, ...]:
        number, xs, ys, *walk = carry
        moved = tuple(walk)
        for _ in range(every):
            moved = step(moved)
        xs, ys = (
            jax.lax.dynamic_update_index_in_dim(kept, new, number, 0) for kept, new in zip((xs, ys), moved[:2], strict=True)
        )
        return (number + 1, xs, ys, *moved)

    filled = (jnp.broadcast_to(start, (max_corners, count)) for start in (start_x, start_y))
    begin = (jnp.int32(1), *filled, start_x, start_y, jnp.zeros_like(start_x), empty)
    found = jax.lax.while_loop(lambda carry: (carry[0] < max_corners) & ~jnp.all(carry[-1]), piece, begin)
    return Contours(found[1], found[2], found[-1])


def polygon_descriptors(x: Array, y: Array, count: int = 20) -> Array:
    """Fourier descriptors (count, M) of closed polygons with corners (K, M); 0 for such as are points.

    Args:
        x: Corners; repeated ones do nothing.
        y: Likewise, downwards; the contour goes clockwise in the picture.
        count: How many: :func:`poseppl.motion.vision.fourier_descriptors`.
    """
    dx, dy = jnp.roll(x, -1, 0) - x, jnp.roll(y, -1, 0) - y
    length = jnp.sqrt(dx**2 + dy**2)
    total = jnp.sum(length, 0)
    before = np.tri(x.shape[0] + 1, x.shape[0], -1)  # a product with it sums up faster than cumsum, which goes step by step
    reached = jnp.tensordot(jnp.asarray(before, x.dtype), length, 1, precision="highest")
    phase = reached * (2 * jnp.pi / jnp.maximum(total, _TINY))
    cosine, sine = computed_once((jnp.cos(phase), -jnp.sin(phase)))
    ux, uy = dx / jnp.maximum(length, _TINY), dy / jnp.maximum(length, _TINY)
    plus, minus = _amplitudes(cosine, sine, ux, uy, count // 2 + 1)
    ordered = [minus[0], *(term for k in range(1, count // 2 + 1) for term in (plus[k], minus[k]))][:count]
    return jnp.stack(ordered) / jnp.maximum(plus[0], _TINY)


def _amplitudes(cosine: Array, sine: Array, ux: Array, uy: Array, most: int) -> tuple[list[Array], list[Array]]:
    """|Z_k| and |Z_-k| (M,) up to a common factor, k = 1 to ``most``, of phases (K + 1, M) and chords (K, M).

    One loop over the corners for all k: sums over an axis that is not the last one do not vectorise.
    """
    one, none = jnp.ones_like(cosine[0]), jnp.zeros_like(cosine[0])

    def corner(carry: list[_Harmonic], row: tuple[Array, Array, Array, Array]) -> tuple[list[_Harmonic], None]:
        c, s, u, v = row
        real, imaginary = one, none
        moved: list[_Harmonic] = []
        for before_real, before_imaginary, a, b, d, e in carry:
            real, imaginary = real * c - imaginary * s, real * s + imaginary * c
            p, q = real - before_real, imaginary - before_imaginary
            moved.append((real, imaginary, a + u * p, b + v * q, d + u * q, e + v * p))
        return moved, None

    begin: list[_Harmonic] = [(one, none, none, none, none, none) for _ in range(most)]
    end, _ = jax.lax.scan(corner, begin, (cosine[1:], sine[1:], ux, uy))
    plus = [jnp.hypot(a - b, d + e) / k**2 for k, (_, _, a, b, d, e) in enumerate(end, 1)]
    minus = [jnp.hypot(a + b, e - d) / k**2 for k, (_, _, a, b, d, e) in enumerate(end, 1)]
    return plus, minus


def _first_point(bits: Array) -> tuple[Array, Array]:
    """Column and row (M,) of the first bit that is set, row by row; of the first one where none is."""
    flat = bits.reshape(-1, bits.shape[2])
    place = jnp.argmax(flat != 0, 0).astype(jnp.int32)
    word = jnp.take_along_axis(flat, place[None], 0)[0]
    lowest = jax.lax.population_count((word & (~word + 1)) - 1).astype(jnp.int32) & 31
    return place % bits.shape[1] * 32 + lowest, place // bits.shape[1]


def _chosen(table: np.ndarray, heading: Array) -> tuple[Array, Array]:
    """X and y of a table's rows: four constants are chosen from faster than they are looked up."""
    columns = (
        jnp.select([heading == row for row in range(3)], [int(v) for v in column[:3]], int(column[3])) for column in table.T
    )
    x, y = columns
    return x.astype(jnp.int32), y.astype(jnp.int32)
