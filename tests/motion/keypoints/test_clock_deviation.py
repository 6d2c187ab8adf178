"""The standard deviation of a clock's offset is that of its errors."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm, t

from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.io import DetectedPeople
from poseppl.motion.keypoints.clock_offsets import coarse_offsets, synchronize

NUM_FRAMES, NUM_POINTS, RATE = 80, 14, 30.0
NOISE = 4.0
"""Standard deviation of a coordinate, px."""
LATE = np.array([0.0, 0.4, -0.3, 0.2])
"""Frames."""
SIZE = 60.0
"""Of the points' oscillations, mm, once a second: noise makes a good part of the slopes."""
REPLICATES, PARTS = 150, 8


@pytest.fixture(autouse=True)
def no_errors_of_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poseppl.motion.keypoints.clock_offsets.SYSTEMATIC", 0.0)


def errors(lasts: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors (R, 3) of offsets, and what is told of them, where errors of a point in a camera last so many frames."""
    centres = [(3000.0, 0, 300), (0.0, 3000, 300), (-2500.0, 1500, 900), (1500.0, -2500, 600)]
    cameras = join_cameras([look_at(centre, (0, 0, 0), 900.0) for centre in centres])
    rng, kept = np.random.default_rng(0), np.exp(-1 / lasts)
    found = []
    for _ in range(REPLICATES):
        phase, size = rng.uniform(0, 2 * np.pi, (NUM_POINTS, 3)), rng.uniform(0, SIZE, (NUM_POINTS, 3))
        times = (np.arange(NUM_FRAMES)[:, None] - LATE) / RATE
        places = size * np.sin(2 * np.pi * times[..., None, None] + phase) + rng.normal(size=(NUM_POINTS, 3)) * 300
        seen = np.asarray(project(cameras, jnp.asarray(places)))[range(4), :, range(4)]
        noise = [rng.normal(size=(4, NUM_POINTS, 2))]
        for _ in range(1, NUM_FRAMES):
            noise.append(kept * noise[-1] + np.sqrt(1 - kept**2) * rng.normal(size=noise[0].shape))
        points = np.moveaxis(seen, 0, 1) + NOISE * np.stack(noise)
        offsets = synchronize(cameras, points, np.ones(points.shape[:-1]), RATE)
        assert offsets is not None
        found.append((offsets.frames[1:] - LATE[1:], offsets.deviation[1:]))
    off, told = map(np.stack, zip(*found, strict=True))
    return off, told


def check(off: np.ndarray, told: np.ndarray) -> None:
    """90 % intervals hold as often as those of a Student-t of 7 degrees of freedom whose quantiles are taken for a normal's."""
    held = (np.abs(off) < norm.ppf(0.95) * told).mean(1)
    least = 1 - 2 * t.sf(norm.ppf(0.95), PARTS - 1)
    print(np.sqrt((off**2).mean()), np.sqrt((told**2).mean()), held.mean(), least)
    assert held.mean() > least - 3 * held.std() / np.sqrt(REPLICATES)
    assert np.sqrt((told**2).mean()) < 1.5 * np.sqrt((off**2).mean())


@pytest.mark.full
def test_noise_by_frames() -> None:
    check(*errors(0.01))


@pytest.mark.full
def test_noise_that_lasts() -> None:
    check(*errors(15.0))


def test_errors_of_calibration_add_up_as_independent_ones_of_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without noise nothing else is left: of three cameras two thirds of the variance of one pair."""
    monkeypatch.setattr("poseppl.motion.keypoints.clock_offsets.SYSTEMATIC", 0.02)
    cameras = join_cameras([look_at(c, (0, 0, 0), 900.0) for c in ((3000.0, 0, 300), (0.0, 3000, 300), (-2500.0, 1500, 900))])
    rng = np.random.default_rng(1)
    phase, size = rng.uniform(0, 2 * np.pi, (NUM_POINTS, 3)), rng.uniform(20, SIZE, (NUM_POINTS, 3))
    turn = 2 * np.pi * np.arange(NUM_FRAMES)[:, None, None] / RATE
    places = size * np.sin(turn + phase) + rng.normal(size=(NUM_POINTS, 3)) * 300
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places)), np.float64), 0, 1)
    found = synchronize(cameras, points, np.ones(points.shape[:-1]), RATE)
    assert found is not None
    np.testing.assert_allclose(found.frames, 0.0, atol=0.02)
    np.testing.assert_allclose(found.deviation[1:], 0.02 * RATE * np.sqrt(2 / 3), rtol=0.02)


def test_whole_frames_by_which_cameras_are_late_are_found() -> None:
    """Of four cameras in two groups, whatever pair stands out first."""
    late = np.array([0, 3, -2, 6])
    centres = [(3000.0, 0, 300), (0.0, 3000, 300), (-2500.0, 1500, 900), (1500.0, -2500, 600)]
    cameras = join_cameras([look_at(centre, (0, 0, 0), 900.0) for centre in centres])
    rng, frames = np.random.default_rng(2), 60
    base = rng.normal(size=(6, 3)) * 300
    times = (np.arange(frames)[:, None] - late) / RATE
    turns = rng.uniform(0.3, 1.3, (6, 3))  # a second, each its own
    places = base + 400 * np.sin(2 * np.pi * turns * times[..., None, None] + rng.uniform(0, 2 * np.pi, (6, 3)))
    people = []
    for c in range(4):
        points = np.asarray(project(cameras, jnp.asarray(places[:, c])), np.float64)[c][:, None]
        people.append(DetectedPeople(points, np.ones(points.shape[:-1]), np.arange(frames), "", tuple("abcdef")))
    np.testing.assert_array_equal(coarse_offsets(cameras, people), late)
