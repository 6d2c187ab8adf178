"""Noise of cameras, from the distances of points to the triangulated positions."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.keypoints.camera_errors import camera_errors

NOISE, FRAMES, POINTS = 4.0, 200, 10


@pytest.mark.parametrize("headings", [(0, 45), (0, 90), (0, 60, 120), (0, 90, 180, 270)])
def test_the_noise_of_cameras_at_one_height_is_reported(headings: tuple[int, ...]) -> None:
    """Two cameras agree in all directions but one, whatever the noise; by single coordinates half of what remains is none."""
    rng = np.random.default_rng(0)
    angles = np.deg2rad(headings)
    middle = (0.0, 0.0, 1000.0)
    centres = [(5000 * float(np.cos(a)), 5000 * float(np.sin(a)), 1000.0) for a in angles]
    cameras = join_cameras([look_at(centre, middle, 1145.0) for centre in centres])
    places = np.asarray(middle) + 400 * rng.standard_normal((FRAMES, POINTS, 3))
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places, float)), np.float64), 0, 1)
    points = clean + NOISE * rng.standard_normal(clean.shape)
    found = camera_errors(cameras, points, triangulate(cameras, points, np.ones(points.shape[:3])))
    # a median of squares of one degree of freedom: the relative standard error of the scale is 1.17 / sqrt(2000)
    assert np.abs(found.scale / NOISE - 1).max() < 4 * 1.17 / np.sqrt(FRAMES * POINTS)
    assert np.abs(found.bias).max() < 4 * 1.2533 * NOISE / np.sqrt(FRAMES * POINTS)
