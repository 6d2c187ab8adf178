"""Sums over outlines and insides: against a plain loop, their edges, and batches in pieces."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodytrack.outline_samples import Room, Spacing, fixed_sums, interval_counts, pad_maps, spaced_sums
from precision import precision

from poseppl.motion.geometry.batch_last import batch_last

ROOMS = (Room(40, 20, 12), Room(24, 16, 12), Room(40, 20, 12))
SIZE = (60, 80)


def quadrilaterals(rng, count, inset=12.0):
    """Corners (2 cameras, 3 parts, 4, 2, N) within the image of 80 x 60 px."""
    low, high = inset, np.array([SIZE[1], SIZE[0]]) - 1 - inset
    middle = rng.uniform(0, 1, (2, 3, 1, 2, count))
    middle = low + middle * (high - low)[:, None]
    angle, half, width = (rng.uniform(*span, (2, 3, 1, 1, count)) for span in ((0, 6.3), (4, 10), (1, 4)))
    along = np.concatenate([np.cos(angle), np.sin(angle)], 3) * half
    across = np.concatenate([-np.sin(angle), np.cos(angle)], 3) * width
    return np.concatenate([-along - across, along - 0.7 * across, along + 0.7 * across, -along + across], 2) + middle


def maps(rng):
    return rng.uniform(size=(2, 2, *SIZE))


@partial(jax.jit, static_argnums=(0, 4, 5))
def summed(sums, corners, edge, inside, spacing, rooms):
    return sums(corners, edge, inside, spacing, rooms)


def by_the_loop(corners, edge, inside, spacing):
    """Sums (4, C) of one batch element (C, P, 4, 2), sample by sample."""
    total = np.zeros((4, len(corners)))

    def look(camera, point, image, row):
        column, line = np.floor(point + 0.5).astype(int)
        if 0 <= column < SIZE[1] and 0 <= line < SIZE[0]:
            total[row, camera] += image[camera, line, column]
            total[row + 1, camera] += 1

    def count(vector, step):
        return max(int(np.hypot(*vector) / step + 0.5), 4)

    for camera, parts in enumerate(corners):
        for a, b, c, d in parts:
            for start, end in ((a, b), (d, c)):
                steps = count(end - start, spacing.edge)
                for k in range(steps + 1):
                    look(camera, start + k / steps * (end - start), edge, 0)
            rows, columns = count(b - a, spacing.inside), count((a + b - c - d) / 2, spacing.inside)
            for i in range(rows + 1):
                left, right = a + i / rows * (b - a), d + i / rows * (c - d)
                for j in range(columns):
                    look(camera, left + j / columns * (right - left), inside, 2)
    return total


@pytest.mark.full
@pytest.mark.parametrize("inset", [12.0, -10.0])
def test_every_sample_is_taken_once(inset):
    """Exact: with half of the parts beyond the image's rim, too, whose samples leave sums and numbers alike."""
    rng = np.random.default_rng(0)
    spacing = Spacing(1.0, 1.5)
    with precision(np.float64):
        corners, (edge, inside) = quadrilaterals(rng, 4, inset), maps(rng)
        found = np.stack(summed(spaced_sums, corners, pad_maps(edge), pad_maps(inside), spacing, ROOMS))
        for n in range(4):
            expected = by_the_loop(corners[..., n], edge, inside, spacing)
            np.testing.assert_allclose(found[..., n], expected, rtol=1e-12)
            assert np.all(expected[1] > 10)
    if inset < 0:
        whole = np.sum(np.asarray(interval_counts(jnp.asarray(corners), spacing)[0]) + 1, (1, 2))
        assert np.any(found[1] < whole)


def test_padded_maps_end_in_a_row_of_zeros():
    padded = pad_maps(jnp.ones((2, *SIZE)))
    assert padded.shape == (2, SIZE[0] + 1, SIZE[1]) and not padded[:, -1].any() and padded[:, :-1].all()


@pytest.mark.full
def test_parts_outside_the_image_leave_no_trace():
    corners = jnp.asarray(quadrilaterals(np.random.default_rng(1), 5)) + 1000.0
    ones = pad_maps(jnp.ones((2, *SIZE)))
    for sums in (spaced_sums, fixed_sums):
        assert not any(np.any(value) for value in summed(sums, corners, ones, ones, Spacing(), ROOMS))
        assert not any(np.any(value) for value in summed(sums, -corners, ones, ones, Spacing(), ROOMS))


@pytest.mark.full
def test_fixed_samples_count_as_much_as_all():
    """The sums of a constant map are exact; those of a smooth one differ by the discretisation of a few px."""
    rng = np.random.default_rng(2)
    with precision(np.float64):
        corners = jnp.asarray(quadrilaterals(rng, 50))
        y, x = np.mgrid[: SIZE[0], : SIZE[1]]
        smooth = pad_maps(jnp.asarray(np.stack([2 + np.sin(x / 20), 2 + np.cos(y / 15)])))
        rooms = (Room(8, 4, 4),) * 3
        fixed, spaced = (
            summed(sums, corners, smooth, smooth, Spacing(1.0, 1.5), room)
            for sums, room in ((fixed_sums, rooms), (spaced_sums, ROOMS))
        )
        np.testing.assert_allclose(fixed.num_edge, spaced.num_edge, rtol=1e-12)
        np.testing.assert_allclose(fixed.num_inside, spaced.num_inside, rtol=1e-12)
        np.testing.assert_allclose(fixed.edge / fixed.num_edge, spaced.edge / spaced.num_edge, rtol=0.02)
        np.testing.assert_allclose(fixed.inside / fixed.num_inside, spaced.inside / spaced.num_inside, rtol=0.03)


@pytest.mark.full
def test_a_room_for_each_part():
    corners, ones = jnp.asarray(quadrilaterals(np.random.default_rng(3), 2)), pad_maps(jnp.ones((2, *SIZE)))
    with pytest.raises(ValueError, match="room for 2 parts; expected one for each of 3"):
        spaced_sums(corners, ones, ones, Spacing(), ROOMS[:2])


@pytest.mark.full
def test_batches_in_pieces_are_the_same(dtype):
    """Exact up to the order of sums: 11 particles at once, in pieces of 4, and one at a time."""
    rng = np.random.default_rng(4)
    corners = jnp.asarray(np.moveaxis(quadrilaterals(rng, 11), -1, 0), dtype)
    edge, inside = (pad_maps(jnp.asarray(image, dtype)) for image in maps(rng))

    def sums(corners, edge, inside):
        return spaced_sums(corners, edge[..., 0], inside[..., 0], Spacing(), (Room(8, 6, 6),) * 3)

    whole, pieces = (
        jax.vmap(lambda c, chunk=chunk: batch_last(sums, chunk=chunk)(c, edge, inside))(corners) for chunk in (None, 4)
    )
    alone = jax.jit(lambda c: batch_last(sums)(c, edge, inside))
    for found, cut, index in zip(whole, pieces, range(4), strict=True):
        assert found.shape == (11, 2)
        np.testing.assert_allclose(cut, found, rtol=100 * np.finfo(dtype).eps)
        np.testing.assert_allclose(found, [alone(c)[index] for c in corners], rtol=100 * np.finfo(dtype).eps)
