"""The errors of a recording's points, from the distances of rays: sizes, confidence, and time constants."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras, join_cameras, look_at, project
from poseppl.motion.keypoints.detector_errors import FREEDOM, magnifications
from poseppl.motion.keypoints.point_errors import (
    CAMERA_SPREAD,
    KEYPOINT_SPREAD,
    SIZE,
    SIZE_SPREAD,
    STANDARD_DEVIATION,
    point_errors,
)
from poseppl.motion.tracking.lasting_errors import POINT_ERRORS, Lasting, lasting_of

FRAMES, RATE = 400, 50.0
SCALES = np.array([10.0, 10.0, 20.0, 20.0])
"""mm, of the keypoints."""


def rig(headings: tuple[int, ...]) -> Cameras:
    middle = (0.0, 0.0, 1000.0)
    angles = np.deg2rad(headings)
    return join_cameras([look_at((5000 * float(np.cos(a)), 5000 * float(np.sin(a)), 1300.0), middle, 1145.0) for a in angles])


def seen(cameras: Cameras, errors: Floats, rng: np.random.Generator) -> Floats:
    """Points (T, C, K, 2) of places that jump about, with errors in mm at the person."""
    places = np.array([0.0, 0.0, 1000.0]) + 400 * rng.standard_normal((len(errors), errors.shape[2], 3))
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places, float)), np.float64), 0, 1)
    return np.asarray(clean + magnifications(cameras, places)[..., None] * errors)


def lasting(rng: np.random.Generator, shape: tuple[int, ...], share: float, seconds: float) -> Floats:
    """Gaussian errors of standard deviation 1, of which a share lasts."""
    kept, slow = np.exp(-1 / RATE / seconds), rng.standard_normal(shape)
    for t in range(1, len(slow)):
        slow[t] = kept * slow[t - 1] + np.sqrt(1 - kept**2) * slow[t]
    return np.asarray(np.sqrt(share) * slow + np.sqrt(1 - share) * rng.standard_normal(shape))


@pytest.mark.parametrize("headings", [(0, 80), (0, 60, 130)])
def test_sizes_by_keypoint_and_confidence(headings: tuple[int, ...]) -> None:
    """Contrasts that are Student-t without an approximation: the errors of a point have one chi-squared variable in common."""
    rng, cameras, slope = np.random.default_rng(0), rig(headings), -0.4
    shape = (FRAMES, len(headings), len(SCALES))
    logit = 1.0 + rng.standard_normal((FRAMES, 1, len(SCALES))) + np.zeros(shape)
    chi = rng.chisquare(FREEDOM, (FRAMES, 1, len(SCALES), 1)) / FREEDOM
    scale = SCALES * np.exp(slope * (logit - 1))
    points = seen(cameras, scale[..., None] * rng.standard_normal((*shape, 2)) / np.sqrt(chi), rng)
    found = point_errors(cameras, points, expit(logit), RATE)
    assert found is not None
    own = np.exp(found.log_mm + found.by_camera.mean() + found.slope * (1 - found.middle))
    # of the log of a Student-t's scale by n numbers of d dimensions: variance (nu + d + 2) / (2 d nu n); the prior, about
    # 15 mm, weighs as much as 25 independent numbers at most
    dimension = 2 * len(headings) - 3
    deviation = np.sqrt((FREEDOM + dimension + 2) / (2 * dimension * FREEDOM * FRAMES))
    assert np.abs(np.log(own / SCALES)).max() < 4 * deviation + np.log(2) / 8
    assert abs(found.slope - slope) < 4 * deviation / 2 + 0.05
    assert found.share < 0.2  # nothing lasts
    noise = found.noise(
        cameras, ("a",) * 4, np.tile([0.0, 0.0, 1000.0], (1, 4, 1)), np.full((1, *shape[1:]), expit(found.middle))
    )
    middle = magnifications(cameras, np.array([[[0.0, 0.0, 1000.0]]]))[0, :, 0]
    wider = np.exp(found.uncertainty[0] ** 2)
    assert noise[0, 0] == pytest.approx(STANDARD_DEVIATION * middle[0] * np.exp(found.log_mm + found.by_camera[0]) * wider)


def scales_of_prior(rng: np.random.Generator, num_cameras: int, num_keypoints: int) -> Floats:
    """Logs (C, K) of scales, mm, as the prior has them."""
    mean = np.log(SIZE) + SIZE_SPREAD * rng.standard_normal()
    by_camera = CAMERA_SPREAD * rng.standard_normal((num_cameras, 1))
    return np.asarray(mean + by_camera + KEYPOINT_SPREAD * rng.standard_normal(num_keypoints))


@pytest.mark.full
def test_noise_has_the_expected_variance() -> None:
    """Scales drawn from the prior, few frames: variances are the noise's on average, in these cameras and in another."""
    ratios = []
    for seed in range(24):
        rng, cameras, num = np.random.default_rng(seed), rig((0, 80)), 12
        true = scales_of_prior(rng, 3, num)
        errors = rng.standard_normal((6, 2, num, 2)) / np.sqrt(rng.chisquare(FREEDOM, (6, 1, num, 1)) / FREEDOM)
        points = seen(cameras, np.exp(true[:2, :, None]) * errors, rng)
        found = point_errors(cameras, points, np.full(points.shape[:3], 0.8), rate=1e-3)  # frames are independent
        assert found is not None
        for errors_of, scales in ((found, true[:2]), (found.in_new_camera(), true[2:])):
            lens, places = rig((0,) * len(scales)), np.zeros((1, num, 3))
            noise = errors_of.noise(lens, ("a",) * num, places, np.full((1, *scales.shape), 0.8))
            ratios.append(np.mean(np.square(STANDARD_DEVIATION * magnifications(lens, places) * np.exp(scales) / noise)))
    for own in (ratios[::2], ratios[1::2]):
        assert abs(np.mean(own) - 1) < 4 * np.std(own, ddof=1) / np.sqrt(len(own)), own


@pytest.mark.parametrize(("share", "seconds"), [(0.85, 0.2), (0.4, 0.6)])
def test_how_long_errors_last(share: float, seconds: float) -> None:
    """Share and time of four replicates: their mean is within four of its standard errors, and the prior's pull."""
    told = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        errors = 15 * lasting(rng, (FRAMES, 3, 4, 2), share, seconds)
        points = seen(rig((0, 60, 130)), errors, rng)
        found = point_errors(rig((0, 60, 130)), points, np.full(points.shape[:3], 0.8), RATE)
        assert found is not None
        told.append((found.share, np.log(found.lasts)))
    mean, error = np.mean(told, 0), np.std(told, 0, ddof=1) / 2
    assert abs(mean[0] - share) < 4 * error[0] + 0.03
    assert abs(mean[1] - np.log(seconds)) < 4 * error[1] + 0.1


def test_nothing_is_reported_by_one_camera() -> None:
    points = np.full((20, 2, 3, 2), np.nan)
    points[:, 0] = 500.0
    assert point_errors(rig((0, 80)), points, np.ones((20, 2, 3)), RATE) is None


def test_runs_of_a_long_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lags do not go across the ends of runs: autocorrelated errors that outlast the gaps give the result of all frames."""
    rng, cameras = np.random.default_rng(5), rig((0, 80))
    points = seen(cameras, 15 * lasting(rng, (FRAMES, 2, 4, 2), 0.8, 0.2), rng)
    whole = point_errors(cameras, points, np.full(points.shape[:3], 0.8), RATE)
    monkeypatch.setattr("poseppl.motion.keypoints.point_errors.MAX_FRAMES", FRAMES // 2)
    part = point_errors(cameras, points, np.full(points.shape[:3], 0.8), RATE)
    assert whole is not None and part is not None
    assert np.allclose(part.log_mm, whole.log_mm, atol=0.15) and abs(part.share - whole.share) < 0.15


@pytest.mark.parametrize("told", [{"share": 1.0, "lasts": 0.5}, {"share": 0.5, "lasts": 0.0}, {"share": "much"}, [0.5, 0.5]])
def test_what_a_file_says_is_checked(told: Any) -> None:
    with pytest.raises(InputError, match=POINT_ERRORS):
        lasting_of({POINT_ERRORS: told})
    assert lasting_of({}) == Lasting()
    assert lasting_of({POINT_ERRORS: {"share": 0.7, "lasts": 0.3}}) == Lasting(0.7, 0.3)
