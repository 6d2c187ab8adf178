from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from poseppl.motion.vision import edge_distance, silhouette_distance

BLOB = np.zeros((60, 90), np.uint8)
BLOB[20:40, 30:50] = 1
BLOB[30:55, 60:64] = 1
RANDOM = (np.random.default_rng(0).random((70, 80)) < 0.02).astype(np.uint8)


@pytest.mark.parametrize("mask", [BLOB, RANDOM, RANDOM[:, :61]])
@pytest.mark.parametrize("truncation", [5.0, 12.5, 500.0])
def test_distances_are_those_of_scipy_to_the_last_digit(mask, truncation):
    # Both are exact Euclidean distances, rounded once to float32: the same from run to run, wherever memory lies.
    outside, inside = (distance_transform_edt(mask == value).astype(np.float32) for value in (0, 1))
    np.testing.assert_array_equal(edge_distance(mask, truncation), np.minimum(outside, np.float32(truncation)))
    half = np.float32(0.5)
    signed = np.where(mask == 1, half - inside, outside - half)
    np.testing.assert_array_equal(silhouette_distance(mask, truncation), np.clip(signed, -truncation, truncation))


def test_signs_and_steps_across_an_outline():
    row = silhouette_distance(BLOB, 4.0)[30]
    np.testing.assert_array_equal(row[24:34], [4, 4, 3.5, 2.5, 1.5, 0.5, -0.5, -1.5, -2.5, -3.5])


def test_a_silhouette_at_the_rim():
    mask = np.zeros((30, 40), np.uint8)
    mask[10:20, :15] = 1
    # Beyond the image nothing is known: the outline is where the image shows background.
    np.testing.assert_allclose(silhouette_distance(mask, 50)[15, :15], np.maximum(-np.arange(14.5, 0, -1), -4.5))


@pytest.mark.full
def test_nothing_and_everything():
    empty, full = np.zeros((20, 30), np.uint8), np.ones((20, 30), np.uint8)
    np.testing.assert_array_equal(edge_distance(empty, 7.0), 7.0)
    np.testing.assert_array_equal(silhouette_distance(empty, 7.0), 7.0)
    np.testing.assert_array_equal(silhouette_distance(full, 7.0), -7.0)
