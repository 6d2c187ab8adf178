"""Evidence that the likelihood of Du and Guan takes from the images of a frame: colours, contours, Fourier descriptors.

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

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import NDArray

from poseppl.compilation import jit
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.batch_last import computed_once
from poseppl.motion.geometry.coverage import outline_corners
from poseppl.motion.geometry.flesh import parts_of
from poseppl_models.bodies.cone_body import ConeBody
from poseppl_models.images.part_samples import index_at, inside_points
from poseppl_models.images.silhouette_bits import pack_mask

Images = NDArray[Any]
GRID = (6, 4)
"""Rows and columns of the pixels of a part whose colours are looked up."""
DESCRIPTORS = 20
_MAX_CORNERS = 256
"""Room for the corners of a contour, of which there is one every 4 steps of the grid."""


class DuGuanEvidence(NamedTuple):
    """Evidence of C cameras.

    Attributes:
        foreground: Words of the grid's foreground (C, rows, words), uint32.
        known: Words of where there is evidence.
        bins: Bin of each pixel's colour, negative without evidence, padded (C, H + 1, W), int32.
        colours: Histograms of the parts that are sought (C, P, bins), shares.
        part_weights: Weight of each part's colours (C, P).
        descriptors: Fourier descriptors of the foreground's contour (C, count); NaN for none, and then contours do not count.
    """

    foreground: Array
    known: Array
    bins: Array
    colours: Array
    part_weights: Array
    descriptors: Array


def du_guan_evidence(
    foreground: Images,
    known: Images,
    bins: Images,
    colours: Images,
    part_weights: Images,
    *,
    stride: int = 4,
) -> DuGuanEvidence:
    """Take the evidence of a frame from its features and colours; contours are those on the grid, where thin gaps close.

    Args:
        foreground: (C, H, W), not 0 at the person.
        known: (C, H, W), not 0 where a pixel is evidence.
        bins: (C, H, W) bins of colours.
        colours: (C, P, bins) histograms of the parts, such as :func:`part_colours` of a frame whose pose is known.
        part_weights: (C, P) weights of the parts.
        stride: Pixels between points of the grid.
    """
    there = np.asarray(known, bool)
    shown, seen = pack_mask(foreground, stride), pack_mask(there, stride)
    found = np.asarray(jit(grid_descriptors)((shown & seen)[..., None]))[..., 0]
    descriptors = np.where(np.any(np.asarray(shown & seen), axis=(1, 2))[:, None], found, np.nan)
    floats = (jnp.asarray(values, float) for values in (colours, part_weights, descriptors))
    return DuGuanEvidence(shown, seen, pad_bins(bins, there), *floats)


def grid_descriptors(bits: Array) -> Array:
    """Fourier descriptors (C, DESCRIPTORS, N) of silhouettes (C, rows, words, N); 0 for an empty one."""
    cameras = bits.shape[0]
    contours = trace_contours(jnp.moveaxis(bits, 0, 2).reshape(*bits.shape[1:3], -1), _MAX_CORNERS)
    found = polygon_descriptors(contours.x.astype(float), contours.y.astype(float), DESCRIPTORS)
    return jnp.moveaxis(found.reshape(DESCRIPTORS, cameras, -1), 1, 0)


def pad_bins(bins: Images, known: Images) -> Array:
    """Bins (C, H, W), -1 where a pixel is no evidence, with one more row of -1: (C, H + 1, W), int32."""
    marked = np.where(known, bins, -1)
    return jnp.asarray(np.pad(marked, ((0, 0), (0, 1), (0, 0)), constant_values=-1), jnp.int32)


def part_colours(body: ConeBody, state: Any, cameras: Cameras, bins: Array, num_bins: int) -> Images:
    """Count the colours (C, P, num_bins) of a body's parts in a known state (d,), from padded bins (C, H + 1, W)."""
    tree, flesh, one, view = jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], (body.tree, body.flesh, state, cameras))
    points = inside_points(outline_corners(view, flesh, parts_of(tree, flesh, jnp.asarray(one, float))), *GRID)
    found = np.asarray(index_at(bins, *points))[..., 0]
    counts = np.stack([np.sum(found == number, -1) for number in range(num_bins)], -1)
    shares: Images = counts / np.maximum(counts.sum(-1, keepdims=True), 1)
    return shares


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
