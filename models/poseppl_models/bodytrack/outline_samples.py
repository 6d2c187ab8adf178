"""Sums of image maps over the outlines and the insides of a body's parts, by sampling.

A part's outline in an image is a quadrilateral (:mod:`poseppl.motion.geometry.coverage`). Maps are sampled along its two sides,
and on a grid inside, rows along the axis and columns across it, at the nearest pixel; what falls outside of the image does not
count. :class:`Spacing` asks for a sample every so many pixels, at least 4 intervals in each direction. Then either

* every sample is taken, as many as there are (:func:`spaced_sums`), with room for the most that there may be; or
* each part gets a fixed number of samples, weighted so that it counts as much as it would have (:func:`fixed_sums`).

Maps have one row more than the image, which is 0 and stands for all that lies outside (:func:`pad_maps`).

Positions, values and sums are computed one after the other. In one expression the compiler would compute the outlines again for
every sample, which is many times slower. A loop over cameras separates the positions from the look-up, which no barrier does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.batch_last import computed_once

_MIN = 4
_ROUNDING = 1e-6


class Spacing(NamedTuple):
    """Pixels between samples: along the sides, and of the grid inside."""

    edge: float = 5.0
    inside: float = 10.0


class Room(NamedTuple):
    """How many intervals of a part there is room for, or that are used: along a side, and rows and columns of the grid."""

    edge: int
    rows: int
    columns: int


class Sums(NamedTuple):
    """Sums of the two maps over the samples of a camera, and how many samples there were, each (C, N)."""

    edge: Array
    num_edge: Array
    inside: Array
    num_inside: Array


class _Group(NamedTuple):
    """Parts with the same room: their corners (C, P, 4, 2, N), and numbers of intervals along both sides, rows and columns."""

    room: Room
    corners: Array
    sides: Array
    rows: Array
    columns: Array


def pad_maps(maps: Array) -> Array:
    """Maps (C, H, W) with the row of zeros that stands for what lies outside: (C, H + 1, W)."""
    return jnp.pad(maps, ((0, 0), (0, 1), (0, 0)))


def spaced_sums(corners: Array, edge_map: Array, inside_map: Array, spacing: Spacing, rooms: Sequence[Room]) -> Sums:
    """Sums over all samples that the spacing asks for, up to the room there is.

    Args:
        corners: Outlines (C, P, 4, 2, N), in pixels.
        edge_map: Padded values (C, H + 1, W) that are summed along the sides.
        inside_map: Padded values (C, H + 1, W) that are summed inside.
        spacing: Pixels between samples.
        rooms: Largest numbers of intervals of each part.
    """
    total = _nothing(corners)
    for room, shape, sides, rows, columns in _groups(corners, spacing, rooms):
        along = _steps(room.edge + 1)[:, None] / sides[:, :, :, None]
        edge = _look_up(*_on_sides(shape, along), along <= 1 + _ROUNDING, edge_map)
        down = _steps(room.rows + 1)[:, None] / rows[:, :, None]
        right = _steps(room.columns)[:, None] / columns[:, :, None]
        taken = (down <= 1 + _ROUNDING)[:, :, :, None] & (right < 1 - _ROUNDING)[:, :, None]
        points = _on_grid(shape, down, right)
        inside = _look_up(*points, taken.reshape(points[0].shape), inside_map)
        total = _add(total, (*edge, *inside), 1.0, 1.0)
    return total


def fixed_sums(corners: Array, edge_map: Array, inside_map: Array, spacing: Spacing, rooms: Sequence[Room]) -> Sums:
    """The same from as many intervals as there is room for, weighted.

    Arguments are those of :func:`spaced_sums`.
    """
    total = _nothing(corners)
    for room, shape, sides, rows, columns in _groups(corners, spacing, rooms):
        along = (_steps(room.edge + 1) / room.edge)[None, None, None, :, None]
        edge = _look_up(*_on_sides(shape, along), None, edge_map)
        down = (_steps(room.rows + 1) / room.rows)[None, None, :, None]
        right = (_steps(room.columns) / room.columns)[None, None, :, None]
        inside = _look_up(*_on_grid(shape, down, right), None, inside_map)
        share = (rows + 1) * columns / ((room.rows + 1) * room.columns)
        total = _add(total, (*edge, *inside), (sides + 1) / (room.edge + 1), share)
    return total


def interval_counts(corners: Array, spacing: Spacing) -> tuple[Array, Array, Array]:
    """Numbers of intervals along both sides (C, P, 2, N), and of the grid's rows and columns (C, P, N)."""
    first, second = corners[:, :, 1] - corners[:, :, 0], corners[:, :, 3] - corners[:, :, 2]
    lengths = jnp.stack([_length(first), _length(second)], 2)
    middle = _length(corners[:, :, 0] + corners[:, :, 1] - corners[:, :, 2] - corners[:, :, 3]) / 2
    return _count(lengths, spacing.edge), _count(lengths[:, :, 0], spacing.inside), _count(middle, spacing.inside)


def _steps(number: int) -> Array:
    return jnp.arange(number, dtype=float)


def _count(length: Array, step: float) -> Array:
    return jnp.maximum(jnp.floor(length / step + 0.5), _MIN)


def _length(vector: Array) -> Array:
    return jnp.sqrt(jnp.sum(vector**2, 2))


def _nothing(corners: Array) -> Sums:
    return Sums(*[jnp.zeros((corners.shape[0], corners.shape[-1]), corners.dtype)] * 4)


def _add(total: Sums, found: tuple[Array, ...], edge_share: Array | float, inside_share: Array | float) -> Sums:
    """Add what each side and each part found, by the share with which its samples count."""
    shares = (edge_share, edge_share, inside_share, inside_share)
    between = [tuple(range(1, value.ndim - 1)) for value in found]
    rows = zip(total, found, shares, between, strict=True)
    return Sums(*[old + jnp.sum(value * share, axes) for old, value, share, axes in rows])


def _groups(corners: Array, spacing: Spacing, rooms: Sequence[Room]) -> Iterator[_Group]:
    if len(rooms) != corners.shape[1]:
        raise ValueError(f"room for {len(rooms)} parts; expected one for each of {corners.shape[1]}")
    corners = computed_once(corners)
    counts = interval_counts(corners, spacing)
    for room in dict.fromkeys(rooms):
        index = np.array([part for part, other in enumerate(rooms) if other == room])
        yield _Group(room, corners[:, index], *(count[:, index] for count in counts))


def _on_sides(corners: Array, along: Array) -> tuple[Array, Array]:
    """Points (C, P, 2, K, N) of both sides at fractions ``along`` of their lengths."""
    starts, ends = corners[:, :, 0::2], corners[:, :, 1::2]
    x, y = (starts[:, :, :, None, i] + along * (ends - starts)[:, :, :, None, i] for i in range(2))
    return x, y


def _on_grid(corners: Array, down: Array, right: Array) -> tuple[Array, Array]:
    """Points (C, P, rows * columns, N) at fractions ``down`` of the sides and ``right`` of the way between them."""
    first, other = corners[:, :, None, 0], corners[:, :, None, 3]
    starts = first + down[:, :, :, None] * (corners[:, :, None, 1] - first)
    ends = other + down[:, :, :, None] * (corners[:, :, None, 2] - other)
    x, y = (starts[:, :, :, None, i] + right[:, :, None] * (ends - starts)[:, :, :, None, i] for i in range(2))
    flat = (*x.shape[:2], -1, x.shape[-1])
    return x.reshape(flat), y.reshape(flat)


def _look_up(x: Array, y: Array, taken: Array | None, maps: Array) -> tuple[Array, Array]:
    """Sums (C, ..., N) of the nearest pixels of points (C, ..., K, N) that are taken (all, if None), and how many these are."""
    cameras, height, width = maps.shape[0], maps.shape[1] - 1, maps.shape[2]

    def place(point: tuple[Array, ...]) -> tuple[Array, Array]:
        column, row, *chosen = point
        counts = (column >= -0.5) & (column < width - 0.5) & (row >= -0.5) & (row < height - 0.5)
        for condition in chosen:
            counts &= condition
        # truncation rounds to the nearest, as nothing that counts is negative; what does not count looks up the row of zeros
        column, row = (
            (jnp.where(counts, axis, outside) + 0.5).astype(jnp.int32) for axis, outside in ((column, 0), (row, height))
        )
        return row * width + column, jnp.sum(counts, -2, dtype=column.dtype)

    places, number = jax.lax.map(place, (x, y) if taken is None else (x, y, jnp.broadcast_to(taken, x.shape)))
    first = jnp.arange(cameras, dtype=jnp.int32).reshape(-1, *(1,) * (x.ndim - 1)) * ((height + 1) * width)
    found = jnp.take(maps.reshape(-1), first + places, mode="clip")
    return jnp.sum(found, -2), number.astype(x.dtype)
