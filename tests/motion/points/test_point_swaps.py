"""Exchanged limbs: the chain against enumeration, and exchanges of one frame in ten, found where they are and nowhere else."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.motion.points.swaps import LASTS, SHARE, SeenPoints, exchanged, swap_probabilities, two_state_smoothing

FRAMES, CAMERAS, PAIRS = 300, 3, (((0, 1), (2, 3)),)


def test_the_chain_is_summed_out_exactly() -> None:
    rng = np.random.default_rng(0)
    likelihood, elapsed = rng.normal(size=(5, 2)), np.array([1.0, 1.0, 2.0, 1.0, 4.0]) / 30
    share = np.zeros((5, 2))
    for path in itertools.product((0, 1), repeat=5):
        probability = SHARE if path[0] else 1 - SHARE
        for t in range(1, 5):
            kept = np.exp(-elapsed[t] / LASTS)
            one = SHARE * (1 - kept) + kept * path[t - 1]
            probability *= one if path[t] else 1 - one
        weight = probability * np.exp(sum(likelihood[t, path[t]] for t in range(5)))
        for t in range(5):
            share[t, path[t]] += weight
    assert np.allclose(two_state_smoothing(likelihood, elapsed), share[:, 1] / share.sum(1), rtol=1e-10)


@pytest.fixture(scope="module")
def legs() -> tuple[SeenPoints, Floats, Floats]:
    """Positions of four points of two legs, their detections, and the exchanged frames of the second camera."""
    rng = np.random.default_rng(1)
    sway = np.cumsum(rng.normal(size=(FRAMES, 1, 4, 2)), 0) * 0.5
    images = np.array([[100.0, 100], [100, 140], [115, 100], [115, 140]]) + sway + np.zeros((1, CAMERAS, 1, 1))
    seen = SeenPoints(images, np.full(images.shape[:3], 2.0), np.full(images.shape[:3], -5.0), np.full((CAMERAS, 2), 500.0))
    points = images + 2.0 * rng.standard_t(5, images.shape)
    points[rng.random(points.shape[:3]) < 0.05] = np.nan
    wrong = np.zeros((FRAMES, CAMERAS, 1))
    wrong[rng.choice(FRAMES, FRAMES // 10, replace=False), 1] = 1.0
    return seen, exchanged(points, wrong, PAIRS), wrong


def test_exchanges_are_found_and_undone(legs: tuple[SeenPoints, Floats, Floats]) -> None:
    seen, points, wrong = legs
    probability = swap_probabilities(points, seen, PAIRS, np.full(FRAMES, 1 / 30))
    assert ((probability > 0.5) == (wrong > 0.5)).mean() > 0.995
    assert (probability > 0.5)[wrong > 0.5].mean() > 0.9
    corrected = exchanged(points, probability, PAIRS)
    off = np.abs(corrected - seen.images)
    assert np.nanquantile(off[:, 1, :, 0], 0.97) < 10 < np.nanquantile(np.abs(points - seen.images)[:, 1, :, 0], 0.93)


@pytest.mark.full
def test_nothing_is_done_where_nothing_is_wrong(legs: tuple[SeenPoints, Floats, Floats]) -> None:
    seen, points, wrong = legs
    right = exchanged(points, wrong, PAIRS)
    probability = swap_probabilities(right, seen, PAIRS, np.full(FRAMES, 1 / 30))
    assert not (probability > 0.5).any()
    assert probability.mean() < SHARE
    assert np.array_equal(exchanged(right, probability, PAIRS), right, equal_nan=True)


@pytest.mark.full
def test_where_limbs_coincide_the_data_tell_nothing(legs: tuple[SeenPoints, Floats, Floats]) -> None:
    seen, points, _ = legs
    images = seen.images.copy()
    images[:, :, 2:] = images[:, :, :2]
    probability = swap_probabilities(points, seen._replace(images=images), PAIRS, np.full(FRAMES, 1 / 30))
    assert np.allclose(probability, SHARE, rtol=1e-6)
