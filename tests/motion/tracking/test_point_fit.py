"""A detector's errors are what cameras do not agree upon, however the points move."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.arrays import double_precision
from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.tracking.named_points import FREEDOM, PointRecording, make_point_problem
from poseppl.motion.tracking.point_fit import fit_points

NUM_FRAMES, NUM_POINTS = 80, 4
ERROR, STEP = 1.0, 4.0
"""Standard deviations, px, of a detector's errors, and of a point's step from frame to frame."""


def rough_walk(seed: int) -> PointRecording:
    """Points that walk at random, which no velocity foresees, in two cameras; errors are independent."""
    rng = np.random.default_rng(seed)
    cameras = join_cameras([look_at((3000.0, 0, 300), (0, 0, 0), 900.0), look_at((0.0, 3000, 0), (0, 0, 0), 900.0)])
    places = np.cumsum(rng.normal(size=(NUM_FRAMES, NUM_POINTS, 3)), 0) * STEP * 3000 / 900
    points = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places))), 0, 1)
    points = points + ERROR * rng.normal(size=points.shape)
    frames = np.arange(NUM_FRAMES)
    return PointRecording(
        tuple("abcd"),
        ("x", "y"),
        cameras,
        np.full((2, 2), 1e3),
        points,
        np.full(points.shape[:3], 0.95),
        frames,
        frames / 30,
        30.0,
        "",
    )


@pytest.mark.slow
def test_motion_that_is_not_foreseen_is_no_error() -> None:
    """Two cameras disagree in one of four coordinates: the deviation is known to within 1 / sqrt(2 T K)."""
    with double_precision():
        params = {name: np.asarray(value) for name, value in fit_points(make_point_problem(rough_walk(0))).items()}
    share = FREEDOM / (FREEDOM - 2) + np.exp(2 * params["log_lasting"]) + np.exp(2 * params["log_bias"])
    error = np.exp(params["log_scale"].mean() + params["camera"].mean()) * np.sqrt(share)
    print(error, params)
    assert abs(np.log(error / ERROR)) < 4 / np.sqrt(2 * NUM_FRAMES * NUM_POINTS)


@pytest.mark.slow
def test_a_single_frame_has_params() -> None:
    """No time passes in it, of which a speed could be told."""
    with double_precision():
        found = fit_points(make_point_problem(rough_walk(0).of_frames(slice(0, 1))), num_rounds=1, num_steps=2)
    assert all(np.isfinite(value).all() for value in found.values())
