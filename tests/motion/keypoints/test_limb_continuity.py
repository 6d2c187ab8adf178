"""Limbs that a detector exchanges for many frames in a row, in one of two cameras."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, join_cameras, look_at, project
from poseppl.motion.keypoints.limb_continuity import limb_pairs, proposed_swaps
from poseppl.motion.points.swaps import exchanged

FRAMES, RATE = 60, 30.0
NAMES = tuple(f"{part}_{side}" for side in "lr" for part in ("hip", "knee", "ankle"))
PAIRS = list(limb_pairs(NAMES).values())


def cameras_apart(degrees: float) -> Cameras:
    middle = (0.0, 0.0, 800.0)
    ends = [(5000 * float(np.cos(a)), 5000 * float(np.sin(a)), 1300.0) for a in np.deg2rad([0.0, degrees])]
    return join_cameras([look_at(end, middle, 1145.0) for end in ends])


def walking(cameras: Cameras, apart: float, noise: float, rng: np.random.Generator) -> Floats:
    """Points (T, C, K, 2) of legs that swing past each other, so far apart, mm, across the way of the walk."""
    phase = 2 * np.pi * np.arange(FRAMES) / RATE
    places = np.empty((FRAMES, 6, 3))
    for side, sign in enumerate((1, -1)):
        for part, (height, swing) in enumerate(((900.0, 20.0), (500.0, 150.0), (90.0, 300.0))):
            places[:, 3 * side + part, 0] = swing * sign * np.sin(phase) + 300 * (np.arange(FRAMES) / RATE - 1)
            places[:, 3 * side + part, 1:] = sign * apart / 2, height
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places, float)), np.float64), 0, 1)
    return np.asarray(clean + noise * rng.standard_normal(clean.shape))


def proposed(cameras: Cameras, points: Floats) -> Floats:
    return proposed_swaps(cameras, points, np.ones(points.shape[:3]), PAIRS, RATE)


@pytest.mark.parametrize("degrees", [49.0, 110.0])
def test_a_long_exchange_is_proposed(degrees: float) -> None:
    """A third of the frames, in the middle; one that ends with the recording; and the frames about them are left alone."""
    rng, cameras = np.random.default_rng(0), cameras_apart(degrees)
    points, wrong = walking(cameras, 300.0, 2.0, rng), np.zeros((FRAMES, 2, 1))
    wrong[20:40, 1] = 1
    wrong[52:, 1] = 1
    found = proposed(cameras, exchanged(points, wrong, PAIRS))
    assert np.array_equal(found, wrong)


@pytest.mark.parametrize("apart", [300.0, 60.0])
def test_legs_that_pass_each_other_are_not_exchanged(apart: float) -> None:
    cameras = cameras_apart(80.0)
    assert not proposed(cameras, walking(cameras, apart, 2.0, np.random.default_rng(1))).any()


def test_points_that_are_not_seen_are_left_out() -> None:
    """Nothing is proposed where no camera sees both legs; gaps do not end an exchange."""
    rng, cameras = np.random.default_rng(2), cameras_apart(80.0)
    points, wrong = walking(cameras, 300.0, 2.0, rng), np.zeros((FRAMES, 2, 1))
    wrong[20:40, 0] = 1
    swapped = exchanged(points, wrong, PAIRS)
    swapped[28:31, 0] = np.nan
    assert np.array_equal(proposed(cameras, swapped), wrong)
    swapped[:, :, 3:] = np.nan
    assert not proposed(cameras, swapped).any()
