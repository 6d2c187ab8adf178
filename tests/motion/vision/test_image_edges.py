from __future__ import annotations

import numpy as np
import pytest

from poseppl.motion.io import read_image
from poseppl.motion.vision import EdgeSettings, benchmark_edge_map, edge_proximity, find_edges, gradient


def test_the_gradient_of_a_ramp():
    y, x = np.mgrid[0:40, 0:60]
    right, down = gradient((2 * x + 3 * y).astype(np.uint8))
    # Sobel masks divided by 8 are exact on a plane: 2 and 3 gray levels a px, the rim aside.
    np.testing.assert_array_equal(right[1:-1, 1:-1], 2.0)
    np.testing.assert_array_equal(down[1:-1, 1:-1], 3.0)


def test_edges_of_a_square():
    image = np.full((60, 80), 50, np.uint8)
    image[20:40, 30:60] = 90  # a step of 40 gray levels is a gradient of 20 on both its sides
    settings = EdgeSettings(threshold=19, dilation=2)
    edges = find_edges(image, settings)
    row = np.flatnonzero(edges[30])
    np.testing.assert_array_equal(row, [29, 30, 59, 60])
    assert not find_edges(image, settings._replace(threshold=21))[30].any()


def test_edges_are_masked_by_the_widened_foreground():
    image = np.random.default_rng(0).integers(0, 255, (60, 80), dtype=np.uint8)
    foreground = np.zeros_like(image)
    foreground[20:40, 30:60] = 1
    settings = EdgeSettings(threshold=10, dilation=3)
    everywhere, masked = find_edges(image, settings), find_edges(image, settings, foreground)
    np.testing.assert_array_equal(masked[20:40, 27:63], everywhere[20:40, 27:63])
    masked[17:43, 27:63] = 0
    assert not masked.any()
    assert not find_edges(image, settings, np.zeros_like(image)).any()
    whole = find_edges(image, settings, np.ones_like(image))
    np.testing.assert_array_equal(whole, everywhere)


@pytest.mark.parametrize("sigma", [1.5, 3.0])
def test_proximity_to_a_straight_edge(sigma):
    edges = np.zeros((80, 100), np.uint8)
    edges[:, 49:51] = 1
    proximity = edge_proximity(edges, sigma)
    assert proximity.dtype == np.float32 and proximity.min() >= 0 and proximity.max() == pytest.approx(1.0, abs=1e-6)
    distance = np.arange(100) - 49.5
    # Sum of two Gaussians 1 px apart; half a px is small beside sigma, so it is nearly one of the same width: 0.07 at
    # the smaller sigma, falling with its square.
    np.testing.assert_allclose(proximity[40], np.exp(-(distance**2) / (2 * sigma**2)), atol=0.16 / sigma**2)
    assert not edge_proximity(np.zeros_like(edges), sigma).any()
    np.testing.assert_array_equal(edge_proximity(np.ones_like(edges), sigma)[30:50, 30:70], 1.0)


def plain_benchmark_map(image):
    """The benchmark's description, pixel by pixel: every stage leaves what it cannot reach at 0."""
    height, width = image.shape
    pixels = image.astype(np.float64)
    binary = np.zeros(image.shape)
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            patch = pixels[y - 1 : y + 2, x - 1 : x + 2]
            across = (np.array([1, 2, 1]) @ patch @ np.array([-1, 0, 1])) / 8
            down = (np.array([-1, 0, 1]) @ patch @ np.array([1, 2, 1])) / 8
            binary[y, x] = 0 if across**2 + down**2 < 16 else 255
    taps = np.exp(-np.square(np.arange(-3, 4)) / 32)
    taps = (taps / taps.sum()).astype(np.float32)
    rows, columns = np.zeros(image.shape, np.float32), np.zeros(image.shape, np.float32)
    for k, tap in enumerate(taps):  # float32, one tap after the other, as the benchmark adds them
        rows[:, 3:-3] += tap * binary.astype(np.float32)[:, k : k + width - 6]
    rows = np.floor(rows)
    for k, tap in enumerate(taps):
        columns[3:-3] += tap * rows[k : k + height - 6]
    return np.floor(columns)


def test_the_benchmark_edge_map():
    rng = np.random.default_rng(1)
    image = rng.integers(0, 4, (30, 40)).repeat(2, 0).repeat(2, 1).astype(np.uint8) * 12
    found = benchmark_edge_map(image)
    assert found.dtype == np.uint8
    # One gray level: OpenCV adds in another order, and a sum next to a whole number may be cut on either side of it.
    difference = np.abs(found.astype(int) - plain_benchmark_map(image))
    assert difference.max() <= 1 and np.mean(difference > 0) < 0.05
    assert not benchmark_edge_map(np.full((20, 20), 77, np.uint8)).any()


@pytest.mark.full
def test_the_benchmark_threshold():
    image = np.zeros((20, 20), np.uint8)
    for step, edge in ((7, False), (8, True)):  # a step of 8 gray levels has a squared magnitude of exactly 16
        image[:, 10:] = step
        assert benchmark_edge_map(image).any() == edge


@pytest.mark.full
def test_recorded_edges(data_dir):
    folder = data_dir / "parsec_bodytrack" / "sequenceB_1"
    for number in (1, 2, 3, 4):
        image = read_image(folder / f"CAM{number}" / "image0000.bmp")
        foreground = (read_image(folder / f"FG{number}" / "image0000.bmp")[..., 0] > 0).astype(np.uint8)
        found = benchmark_edge_map(image)
        patch = np.s_[100:180, 200:300]
        expected = plain_benchmark_map(image[..., 0][np.s_[90:190, 190:310]])[10:-10, 10:-10]
        # Over the whole images 0.02 to 0.12 % of the pixels differ, by one gray level.
        assert np.abs(found[patch] - expected).max() <= 1 and np.mean(found[patch] != expected) < 0.005
        # A person's outline has more edges than the room about it: found 2.8 to 3.9 % of all px, of 5 to 7.5 % foreground.
        masked = find_edges(image, EdgeSettings(), foreground)
        assert 0.02 < masked.mean() < 0.05
        outline = foreground - (np.roll(foreground, 1, 0) & np.roll(foreground, 1, 1) & foreground)
        proximity = edge_proximity(masked, EdgeSettings().sigma)
        assert proximity[outline == 1].mean() > 0.5 > 5 * proximity[foreground == 0].mean()
