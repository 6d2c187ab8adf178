"""Weights of flow: across edges, not along them; not on a blank wall, nor where pixels do not look alike."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from poseppl.motion.vision import WeightSettings, dense_flow, flow_outliers, flow_weights

STILL = np.zeros((60, 80, 2), np.float32)
NONE = np.zeros((60, 80), np.uint8)


def stripes(angle):
    """A picture of stripes whose gradients have a direction."""
    y, x = np.mgrid[:60, :80]
    return np.uint8(128 + 60 * np.sin(0.5 * (np.cos(angle) * x + np.sin(angle) * y)))


def matrices(image, **settings):
    xx, xy, yy = flow_weights(image, image, STILL, NONE, WeightSettings(**settings))[:, 30, 40]
    return np.array([[xx, xy], [xy, yy]], float)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, 2.5])
def test_stripes_tell_of_motion_across_them_alone(angle):
    """The root has the closed form of W = S (S + n^2)^-1, whose eigenvectors are those of S = g^2 n n^T."""
    values, vectors = np.linalg.eigh(matrices(stripes(angle)))
    assert values[1] > 0.9 and values[0] < 0.35
    assert abs(vectors[:, 1] @ [np.cos(angle), np.sin(angle)]) > 0.99


def test_the_root_is_that_of_the_weights():
    """W from S in one formula; with another noise it is another."""
    texture = np.uint8(128 + 400 * gaussian_filter(np.random.default_rng(0).normal(size=(60, 80)), 2.0))
    weak, strong = (matrices(texture, noise=noise) for noise in (8.0, 2.0))
    square = {noise: root @ root for noise, root in ((8.0, weak), (2.0, strong))}
    tensor = {noise: noise**2 * each @ np.linalg.inv(np.eye(2) - each) for noise, each in square.items()}
    np.testing.assert_allclose(tensor[8.0], tensor[2.0], rtol=1e-2)
    assert np.abs(square[8.0] - square[2.0]).max() > 0.1


def test_a_blank_wall_tells_nothing():
    blank = np.full((60, 80), 128, np.uint8)
    assert flow_weights(blank, blank, STILL, NONE).max() < 1e-6


def test_what_does_not_look_alike_is_not_believed():
    """A square that has leapt farther than flow is sought, and was given the flow of the wall behind it."""
    rng = np.random.default_rng(1)
    wall = np.uint8(100 + 200 * gaussian_filter(rng.normal(size=(60, 80)), 1.5))
    first, second = wall.copy(), wall.copy()
    patch = np.uint8(200 + 100 * gaussian_filter(rng.normal(size=(16, 16)), 1.5))
    first[20:36, 8:24], second[20:36, 52:68] = patch, patch
    weights = flow_weights(first, second, STILL, NONE)
    assert weights[0, 28, 16] < 0.05 < 0.5 < weights[0, 8, 40]


@pytest.mark.full
def test_flow_that_does_not_return_is_not_believed():
    image = stripes(0.3)
    forth, back = dense_flow(image, image), dense_flow(image, image) + np.float32(5.0)
    assert flow_weights(image, image, forth, flow_outliers(forth, back)).max() == 0.0


@pytest.mark.full
def test_settings_out_of_range():
    with pytest.raises(ValueError, match="noise"):
        flow_weights(stripes(0.0), stripes(0.0), STILL, NONE, WeightSettings(noise=0.0))
