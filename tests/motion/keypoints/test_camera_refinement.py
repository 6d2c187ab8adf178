"""Refined poses of cameras: their posterior against curvatures, of points that agree and of one that is far off."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, join_cameras, look_at, project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.keypoints.camera_refinement import PRIOR_ANGLE, PRIOR_POSITION, PRIOR_WEIGHT, bundle_adjust

FRAMES, POINTS, NOISE = 6, 8, 5.0
SCALE = np.repeat([PRIOR_ANGLE, PRIOR_POSITION], 3)


def moved(cameras: Cameras, errors: Floats) -> Cameras:
    """Cameras with errors (C, 6), turns and shifts in standard deviations of the prior."""
    turns = Rotation.from_rotvec(errors[:, :3] * PRIOR_ANGLE).as_matrix()
    rotation = jnp.asarray(turns @ np.asarray(cameras.rotation, np.float64), float)
    return cameras._replace(rotation=rotation, centre=cameras.centre + jnp.asarray(errors[:, 3:] * PRIOR_POSITION, float))


def seen_by(cameras: Cameras, places: Floats) -> Floats:
    return np.moveaxis(np.asarray(project(cameras, jnp.asarray(places, float)), np.float64), 0, 1)


@pytest.fixture(scope="module")
def cameras() -> Cameras:
    centres = [(4000.0 * np.cos(a), 4000.0 * np.sin(a), 1200.0) for a in (0.0, 1.4, 2.9)]
    return join_cameras([look_at(centre, (0.0, 0.0, 1000.0), 1100.0) for centre in centres])


@pytest.fixture(scope="module")
def places() -> Floats:
    return np.array([0.0, 0.0, 1000.0]) + 400 * np.random.default_rng(0).standard_normal((FRAMES, POINTS, 3))


@pytest.mark.parametrize("rate", [1.0, 3.0])
def test_points_that_agree_leave_the_curvature_of_students_density(cameras: Cameras, places: Floats, rate: float) -> None:
    """Frames of a second count as one; the prior is narrower by the errors that are not there."""
    points = seen_by(cameras, places)
    found = bundle_adjust(cameras, points, np.ones(points.shape[:3]), NOISE, rate)
    step, columns = 0.1, []
    for unit in np.eye(18).reshape(18, 3, 6):
        ends = []
        for sign in (1, -1):
            other = moved(cameras, sign * step * unit)
            ends.append(seen_by(other, triangulate(other, points, np.ones(points.shape[:3]))).ravel())
        columns.append((ends[0] - ends[1]) / (2 * step * NOISE))
    slopes = np.stack(columns, 1)
    curvature = (2 * student.logpdf(0.0, 4) - student.logpdf([1e-3, -1e-3], 4).sum()) / 1e-6
    told = slopes.T @ slopes * curvature / rate
    width = PRIOR_WEIGHT / (PRIOR_WEIGHT + np.trace(told @ np.linalg.inv(told + np.eye(18))))
    unit = np.tile(SCALE, 3)
    exact = np.linalg.inv(told + np.eye(18) / width) * np.outer(unit, unit)
    deviation = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(np.concatenate([found.turn_deviation, found.shift_deviation], 1).ravel(), deviation, rtol=0.02)
    np.testing.assert_allclose(
        found.covariance / np.outer(deviation, deviation), exact / np.outer(deviation, deviation), atol=0.02
    )
    assert np.abs(found.turn).max() < 0.02 * PRIOR_ANGLE and np.abs(found.shift).max() < 0.02 * PRIOR_POSITION


@pytest.mark.full
def test_a_known_error_is_found_and_a_point_that_is_far_off_hardly_counts(cameras: Cameras, places: Floats) -> None:
    """One camera is turned; a detection of another person moves it by less than a third of the posterior SD."""
    errors = np.zeros((3, 6))
    errors[1, :3] = [1.0, -0.5, 0.8]
    points = seen_by(moved(cameras, errors), places)
    plain = bundle_adjust(cameras, points, np.ones(points.shape[:3]), 1.0, 1.0)
    # what cameras have in common nothing tells: the turn of one against the mean of all
    np.testing.assert_allclose((plain.turn[1] - plain.turn[[0, 2]].mean(0)) / PRIOR_ANGLE, errors[1, :3], atol=0.3)
    points[2, 0, 3] += 400.0
    astray = bundle_adjust(cameras, points, np.ones(points.shape[:3]), 1.0, 1.0)
    assert (np.abs(astray.turn - plain.turn) < plain.turn_deviation / 3).all()
