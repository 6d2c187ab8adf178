"""Silhouettes as bits, their contours, and samples on parts, against plain NumPy and OpenCV's own."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.plain_outlines import camera_of, cones_of, hull_silhouette
from poseppl_models.du_guan.evidence import polygon_descriptors, trace_contours
from poseppl_models.du_guan.likelihood import du_guan_body
from poseppl_models.images.part_samples import bilinear, nearest, pad_maps, weighted_mean
from poseppl_models.images.silhouette_bits import body_bits, count_ones, grid_points, pack_mask, unpack_bits
from precision import precision

from poseppl.motion.geometry import look_at
from poseppl.motion.geometry.flesh import part_frames, parts_of
from poseppl.motion.vision import fourier_descriptors, outer_contour

pytestmark = pytest.mark.full

HEIGHT, WIDTH = 120, 160


def blobs(seed, size=(60, 90)):
    """Overlapping ellipses."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    mask = np.zeros(size, bool)
    for _ in range(4):
        a, b, angle = rng.uniform(6, 16), rng.uniform(6, 16), rng.uniform(0, np.pi)
        dx, dy = x - size[1] / 2 - rng.uniform(-9, 9), y - size[0] / 2 - rng.uniform(-9, 9)
        u, v = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
        mask |= (u / a) ** 2 + (v / b) ** 2 <= 1
    return mask


@pytest.mark.parametrize("stride", [1, 3])
def test_packing_round_trip(stride):
    mask = np.random.default_rng(0).random((2, 20, 75)) < 0.4
    taken = mask[:, grid_points(20, stride)][:, :, grid_points(75, stride)]
    bits = pack_mask(mask, stride)
    np.testing.assert_array_equal(unpack_bits(bits, taken.shape[2]), taken)
    np.testing.assert_array_equal(count_ones(bits[..., None])[:, 0], taken.sum((1, 2)))


@pytest.mark.slow
def test_bodies_cover_their_convex_hulls():
    """The true image of a cone is the hull of its rings' images: rings that are no ellipses, and corners, are under 1%."""
    body = du_guan_body()
    view = look_at((2000, -2800, 1200), (0, 0, 900), 210.0)._replace(principal=jnp.array([[79.5, 59.5]]))
    state = jnp.asarray(body.rest, float)
    expected = hull_silhouette(
        camera_of(view, 0), cones_of(body.flesh, part_frames(body.tree, body.flesh, state)), HEIGHT, WIDTH
    )
    last = jax.tree.map(lambda leaf: leaf[..., None], (view, body.tree, body.flesh, state))

    def bits(cameras, tree, flesh, states, stride):
        return body_bits(cameras, flesh, parts_of(tree, flesh, states), HEIGHT // stride, 5, stride)

    found = unpack_bits(jax.jit(bits, static_argnums=4)(*last, 1)[..., 0], WIDTH)[0]
    assert expected.sum() > 1000 and np.sum(found ^ expected) < 0.01 * expected.sum()
    coarse = jax.jit(bits, static_argnums=4)(*last, 4)[..., 0]
    np.testing.assert_array_equal(unpack_bits(coarse, WIDTH // 4)[0], found[2::4, 2::4])


@pytest.mark.parametrize("seed", range(4))
def test_descriptors_of_traced_contours(seed):
    """Against OpenCV's contour through the centres of pixels, sampled at 512 points: half a pixel of 25, so 0.03 at most."""
    mask = blobs(seed)
    contours = trace_contours(jnp.moveaxis(pack_mask(mask[None], 1), 0, 2), 256, 4)
    assert bool(contours.closed[0])
    found = polygon_descriptors(contours.x.astype(float), contours.y.astype(float), 20)[:, 0]
    expected = fourier_descriptors(outer_contour(mask.astype(np.uint8)), 20)
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_descriptors_of_polygons():
    """Against the same polygon sampled densely: trapezoids of 512 points alias by the square of the step."""
    with precision(np.float64):
        angles = np.linspace(0, 2 * np.pi, 13)[:-1]
        radius = np.random.default_rng(0).uniform(5, 10, 12)
        x, y = radius * np.cos(angles), radius * np.sin(angles)
        found = polygon_descriptors(jnp.asarray(x)[:, None], jnp.asarray(y)[:, None], 20)[:, 0]
    np.testing.assert_allclose(found, fourier_descriptors(np.stack([x, y], 1), 20), atol=2e-3)


def test_contours_go_around_corners_once():
    """A ring with a hole, two squares that touch at a corner, one point, nothing, and a contour that is cut short."""
    masks = np.zeros((4, 12, 12), bool)
    masks[0, 2:10, 2:10], masks[0, 4:8, 4:8] = True, False
    masks[1, 1:4, 1:4], masks[1, 4:7, 4:7] = True, True
    masks[2, 5, 5] = True
    bits = jnp.moveaxis(pack_mask(masks, 1), 0, 2)
    found = trace_contours(bits, 64, 1)
    assert found.closed.tolist() == [True] * 4
    x, y = (np.asarray(corners, float) for corners in found[:2])
    area = 0.5 * np.sum(x * np.roll(y, -1, 0) - np.roll(x, -1, 0) * y, 0)
    assert area.tolist() == [64.0, 18.0, 1.0, 0.0]
    assert np.all(polygon_descriptors(jnp.asarray(x[:, 3:]), jnp.asarray(y[:, 3:]), 6) == 0)
    assert trace_contours(bits, 20, 1).closed.tolist() == [False, False, True, True]


def test_samples_of_maps():
    """Negative values and points outside count neither as value nor as number; between pixels values are interpolated."""
    maps = np.arange(20.0).reshape(1, 4, 5)
    maps[0, 1, 2] = -1.0
    x, y = np.array([0.4, 2.1, -0.6, 4.4, 3.0]), np.array([0.0, 0.9, 1.0, 3.4, 2.5])
    args = (pad_maps(jnp.asarray(maps)), jnp.asarray(x)[None, :, None], jnp.asarray(y)[None, :, None])
    found = nearest(*args)
    assert found.value[0, :, 0].tolist() == [0.0, 0.0, 0.0, 19.0, 18.0] and found.seen[0, :, 0].tolist() == [1, 0, 0, 1, 1]
    np.testing.assert_allclose(weighted_mean(found, jnp.ones((1, 1, 1)), 9.0), [[37 / 3]], rtol=1e-6)
    assert weighted_mean(found, jnp.zeros((1, 1, 1)), 9.0).tolist() == [[9.0]]
    smooth = bilinear(*args)
    np.testing.assert_allclose(smooth.value[0, [0, 4], 0], [0.4, 15.5], rtol=1e-6)
    np.testing.assert_allclose(smooth.seen[0, :, 0], [1.0, 1 - 0.9 * 0.9, 0.4, 0.6 * 0.6, 1.0], rtol=1e-5)
