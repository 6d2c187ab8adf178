"""The errors of a detector: found in simulated keypoints, held by held-out cameras, kept in a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import expit, logit

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.geometry.cameras import join_cameras, look_at
from poseppl.motion.keypoints.detector_calibration import LEVELS, errors_at, judge
from poseppl.motion.keypoints.detector_errors import GAUSSIAN, DetectorErrors, magnifications
from poseppl.motion.keypoints.detector_files import read_detector_errors, write_detector_errors
from poseppl.motion.keypoints.detector_fit import fit_detector
from poseppl.motion.keypoints.held_out_cameras import SeenPoints, seen_points

TRUE = DetectorErrors(
    {"wrist": np.log(8.0), "elbow": np.log(12.0), "knee": np.log(16.0), "hip": np.log(24.0)},
    slope=-0.6,
    clutter=-4.0,
    clutter_slope=-0.7,
    confidence=0.65,
    counts={"wrist": 1, "elbow": 2, "knee": 3, "hip": 4},
    source="a drawing",
)
MARKERS = tuple(TRUE.log_scale)
SIZE = 1000.0


def cameras_around(count: int) -> Cameras:
    """Cameras 4 m from the middle, 70 degrees apart."""
    angles = np.deg2rad(70) * np.arange(count)
    each = [look_at((4000 * np.cos(a), 4000 * np.sin(a), 1200.0), (0.0, 0.0, 1000.0), SIZE) for a in angles]
    return join_cameras([camera._replace(principal=jnp.full((1, 2), SIZE / 2)) for camera in each])


def drawn(rng: np.random.Generator, num_cameras: int, num_frames: int) -> SeenPoints:
    """Detections of known positions by cameras, with the errors above."""
    cameras = cameras_around(num_cameras)
    places = rng.uniform((-500, -500, 300), (500, 500, 1700), (num_frames, len(MARKERS), 3))
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places))), 0, 1)
    confidence = expit(logit(TRUE.confidence) + rng.normal(0, 0.7, clean.shape[:-1]))
    scale, odds = TRUE.scale_and_odds(TRUE.log_scales(MARKERS), logit(confidence))
    scale = scale * magnifications(cameras, places)
    student = rng.standard_normal(clean.shape) / np.sqrt(rng.chisquare(4, (*clean.shape[:-1], 1)) / 4)
    points = clean + scale[..., None] * student
    points = np.where(rng.random(odds.shape)[..., None] < expit(odds)[..., None], rng.uniform(0, SIZE, points.shape), points)
    return seen_points(cameras, points, confidence, np.full((num_cameras, 2), SIZE))


def found(seen: SeenPoints) -> Floats:
    """Estimates of a fit, at the middle confidence of the true errors."""
    errors = fit_detector(seen, MARKERS, "")
    scale, odds = errors.scale_and_odds(errors.log_scales(MARKERS), logit(TRUE.confidence))
    return np.array([*np.log(scale), errors.slope, odds, errors.clutter_slope])


@pytest.mark.full
def test_errors_are_recovered() -> None:
    """Means of five drawings lie within five standard errors, and these are small enough to tell."""
    rng = np.random.default_rng(0)
    each = np.stack([found(drawn(rng, 3, 150)) for _ in range(5)])
    error = each.std(0, ddof=1) / np.sqrt(len(each))
    truth = np.array([*TRUE.log_scale.values(), TRUE.slope, TRUE.clutter, TRUE.clutter_slope])
    assert (error[:5] < 0.04).all()
    assert (np.abs(each.mean(0) - truth) < 5 * np.maximum(error, 0.005)).all()


@pytest.mark.slow
@pytest.mark.parametrize("num_cameras", [3, 4])
def test_intervals_of_held_out_cameras_hold(num_cameras: int) -> None:
    seen = drawn(np.random.default_rng(1), num_cameras, 250)
    right = judge(seen, *errors_at(TRUE, seen, MARKERS))
    error = np.sqrt(LEVELS * (1 - LEVELS) / (2 * len(seen.marker)))  # as if a point's cameras had the same information
    assert (np.abs(right.levels - LEVELS) < 5 * error).all()
    for wrong in (TRUE._replace(slope=0.6), TRUE._replace(clutter=-20.0)):
        judged = judge(seen, *errors_at(wrong, seen, MARKERS))
        assert judged.log_density < right.log_density - 0.05
    small = judge(seen, *(errors_at(TRUE, seen, MARKERS) * np.array([0.7, 1])[:, None, None]))
    assert small.levels[4] < right.levels[4] - 0.05


@pytest.mark.full
def test_what_three_cameras_do_not_see_tells_nothing() -> None:
    with pytest.raises(InputError, match="three cameras see 0 points"):
        fit_detector(drawn(np.random.default_rng(0), 2, 100), MARKERS, "")


def test_noise_of_keypoints() -> None:
    """In px, as Gaussians with the quartiles of the errors: larger nearby, and where the detector is less sure."""
    cameras = cameras_around(2)
    places = np.array([[[0.0, 0.0, 1000.0], [0.0, 0.0, 1000.0]], [[1000.0, 0.0, 1000.0], [np.nan, 0.0, 0.0]]])
    confidence = np.full((2, 2, 2), TRUE.confidence)
    confidence[1, :, 0] = expit(logit(TRUE.confidence) - 1)
    _, odds = TRUE.scale_and_odds(np.zeros(2), logit(confidence))
    noise = TRUE.noise(cameras, ("wrist", "nose"), places, confidence) * np.sqrt(expit(-odds))  # but for clutter
    assert 0.01 < expit(odds[0, 0, 0]) < expit(odds[1, 0, 0]) < 0.04
    far = np.linalg.norm(np.array([4000.0, 0.0, 200.0]))
    mean = np.exp(np.mean(list(TRUE.log_scale.values())))
    np.testing.assert_allclose(noise[0, 0], GAUSSIAN * np.array([8.0, mean]) * SIZE / far, rtol=1e-5)
    near = far - 4000 / far * 1000  # along the optical axis
    np.testing.assert_allclose(noise[1, 0, 0], GAUSSIAN * 8.0 * np.exp(0.6) * SIZE / near, rtol=1e-5)
    np.testing.assert_allclose(noise[1, 0, 1], GAUSSIAN * mean * SIZE / far, rtol=1e-5)  # where it is not known: the median
    with pytest.raises(InputError, match="distance from the person"):
        TRUE.noise(cameras, ("wrist", "nose"), np.full((2, 2, 3), np.nan), confidence)


def test_files_give_back_what_they_were_given(tmp_path: Path) -> None:
    write_detector_errors(TRUE, path := tmp_path / "errors.json")
    back = read_detector_errors(path)
    assert back.log_scale == pytest.approx(TRUE.log_scale)
    assert back._replace(log_scale={}) == TRUE._replace(log_scale={})


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"poseppl_detector_errors": 2}, "poseppl_detector_errors: no errors of a detector"),
        ({"slope": "steep"}, "slope is 'steep'"),
        ({"slope": 11}, "slope: 11 (expected -10 to 10)"),
        ({"confidence": 1.5}, "confidence: 1.5"),
        ({"scale_mm": {"wrist": -1}}, "scale_mm.wrist: -1"),
        ({"scale_mm": {}}, "scale_mm: no marker"),
        ({"scale_mm": 3}, "scale_mm: no numbers by name"),
        ({"source": None}, "source: no text"),
        ({"other": 3}, "the field 'other' is unknown"),
    ],
)
def test_damaged_files_are_named(tmp_path: Path, change: dict[str, Any], expected: str) -> None:
    write_detector_errors(TRUE, path := tmp_path / "errors.json")
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError) as raised:
        read_detector_errors(path)
    assert str(path) in str(raised.value) and expected in str(raised.value)


@pytest.mark.full
def test_files_that_lack_a_field_or_an_end(tmp_path: Path) -> None:
    write_detector_errors(TRUE, path := tmp_path / "errors.json")
    whole = path.read_text()
    path.write_text(json.dumps({name: value for name, value in json.loads(whole).items() if name != "slope"}))
    with pytest.raises(InputError, match="the field 'slope' is missing"):
        read_detector_errors(path)
    path.write_text(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="malformed JSON"):
        read_detector_errors(path)
