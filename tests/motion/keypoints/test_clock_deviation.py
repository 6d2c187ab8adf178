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
"""Amplitude of the points' oscillations, mm, once a second: noise makes a large part of the slopes."""
REPLICATES, PARTS = 150, 8


@pytest.fixture(autouse=True)
def no_errors_of_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poseppl.motion.keypoints.clock_offsets.SYSTEMATIC", 0.0)


def errors(lasts: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors (R, 3) of offsets, and their reported SD, if errors of a point in a camera last this number of frames."""
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
    """The coverage of 90 % intervals is that of a Student-t of 7 degrees of freedom with a normal's quantiles."""
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
    """Four cameras in two groups, whatever pair stands out first."""
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


def test_a_walk_of_a_stride_and_a_half_is_not_shifted_by_a_stride() -> None:
    """Calibrations that are off by up to 60 mm; the person walks 1.9 m, and each foot swings with a period of 66 frames."""
    rng, late, frames = np.random.default_rng(0), np.array([0, 4, -3, 5]), np.arange(90)
    centres = np.array([(3000.0, 3000, 1500), (3000.0, -3000, 1500), (-3000.0, 3000, 1500), (-3000.0, -3000, 1500)])
    true, believed = (
        join_cameras([look_at(centre, target, 900.0) for centre, target in zip(centres, targets, strict=True)])
        for targets in (np.zeros((4, 3)), rng.uniform(-60, 60, (4, 3)))
    )
    people = []
    for c in range(4):
        seconds = (frames - late[c])[:, None] / 60
        swing = np.sin(2 * np.pi * seconds / 1.1 + np.array([0, np.pi, 0, np.pi, 0, np.pi]))
        along = 1300.0 * (seconds - 0.75) + np.array([350, 350, 150, 150, 20, 20]) * swing
        height = np.array([100, 100, 500, 500, 1400, 1400]) + np.array([100, 100, 30, 30, 0, 0]) * np.clip(swing, 0, 1)
        places = np.stack([along, np.tile([-100.0, 100.0], (90, 3)), height - 900], -1)
        points = np.asarray(project(true, jnp.asarray(places)), np.float64)[c][:, None]
        people.append(DetectedPeople(points, np.ones(points.shape[:-1]), frames, "", tuple("abcdef")))
    assert np.abs(coarse_offsets(believed, people) - late).max() <= 1
