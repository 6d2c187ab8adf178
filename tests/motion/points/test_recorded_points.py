"""Points smoothed with NumPy: the mode that the programs lead to, with outliers, gaps and lenses."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.named_points import motion_transition

from poseppl.compilation import double_precision
from poseppl.motion.geometry import join_cameras, look_at
from poseppl.motion.geometry.recorded_frames import image_points
from poseppl.motion.points.fit import points_mode
from poseppl.motion.points.named_points import PointRecording, make_point_problem
from poseppl.motion.points.recorded_points import KnownErrors, motion_step, recorded_points
from poseppl.motion.points.smoothing import seen_points

RATE, NUM_FRAMES, NUM_POINTS = 50.0, 14, 3


def recording() -> PointRecording:
    """Three points on arcs, seen by two cameras in pixels, with one point far away in a frame and one missing in some."""
    rng = np.random.default_rng(0)
    eyes = [look_at((0.0, -3000.0, 500.0), (0.0, 0.0, 0.0), 1000.0), look_at((2500.0, -800.0, 300.0), (0.0, 0.0, 0.0), 900.0)]
    cameras = join_cameras(eyes)
    cameras = cameras._replace(
        principal=jnp.full((2, 2), 500.0), distortion=jnp.tile(jnp.array([0.05, -0.02, 0.001, 0.002, 0.0]), (2, 1))
    )
    angle = np.arange(NUM_FRAMES) / 10
    arc = 300 * np.stack([np.cos(angle), np.sin(angle), 0.5 * angle], -1)
    places = arc[:, None] + rng.normal(size=(NUM_POINTS, 3)) * 200
    points = np.moveaxis(image_points(cameras, places), 0, 1) + 3 * rng.standard_normal((NUM_FRAMES, 2, NUM_POINTS, 2))
    points[5, 0, 1] += 150.0
    points[3:6, 1, 2] = np.nan
    confidence = rng.uniform(0.4, 0.99, points.shape[:3])
    frames = np.arange(NUM_FRAMES)
    sizes = np.full((2, 2), 1000.0)
    return PointRecording(("a", "b", "c"), ("", ""), cameras, sizes, points, confidence, frames, frames / RATE, RATE, "")


@pytest.mark.full
def test_points_are_seen_where_the_programs_mode_is() -> None:
    """To a hundredth of a pixel, and with the same scales and log-odds of clutter."""
    given = recording()
    errors = KnownErrors(np.array([2.0, 3.0]), np.array([500.0, 700.0, 400.0]), 0.25, -0.15, -5.0, -0.7, 0.25, 0.5)
    found = recorded_points(given, errors)
    with double_precision():
        problem = make_point_problem(given)
        log_size = np.log(errors.size / np.asarray(problem.inputs.magnification[0]))
        values = {
            "log_size": log_size.mean(),
            "log_scale": np.zeros(NUM_POINTS),
            "log_speed": np.log(errors.speed * problem.frame.unit),
            "log_speed_lasts": np.log(errors.speed_lasts),
            "camera": log_size - log_size.mean(),
            "slope": errors.slope,
            "clutter": errors.clutter,
            "clutter_slope": errors.clutter_slope,
            "log_lasting": 0.0,
            "log_bias": np.log(errors.bias),
            "log_lasts": np.log(errors.lasts),
        }
        params = {name: jnp.asarray(value, float) for name, value in values.items()}
        expected = seen_points(problem, params, points_mode(problem, params, num_steps=15))
    np.testing.assert_allclose(found.images, expected.images, atol=0.05)
    assert np.median(np.abs(found.images - expected.images)) < 0.005
    np.testing.assert_allclose(found.scales, expected.scales, rtol=1e-6)
    np.testing.assert_allclose(found.clutter, expected.clutter, rtol=1e-6)
    assert np.linalg.norm(found.images[5, 0, 1] - given.points[5, 0, 1]) > 100  # the outlier does not lead the point away


@pytest.mark.parametrize("elapsed", [1e-4, 0.004, 0.02, 0.5, 5.0])
def test_steps_of_places_and_velocities_are_those_of_the_programs(elapsed: float) -> None:
    with double_precision():
        expected = motion_transition(jnp.asarray(elapsed), jnp.asarray(0.25))
    for own, other in zip(motion_step(elapsed, 0.25), expected, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-9)
