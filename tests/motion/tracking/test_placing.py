"""Cameras that are placed around a path: where they stand, what they see, and the calibrations that are made of them."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry import project
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras

PATH = np.array([[0.0, 0.0, 1000.0], [np.nan] * 3, [100.0, 2000.0, 1000.0], [0.0, 4000.0, 1000.0]])
"""Four metres along Y, a little to the side in the middle."""


@pytest.mark.parametrize(
    ("view", "places"),
    [
        (0.0, [(50.0, 9000.0), (-5000.0, 2000.0)]),  # in front of the person, then on the left
        (90.0, [(5100.0, 2000.0), (50.0, 9000.0)]),  # on the right, then in front
    ],
)
def test_cameras_stand_at_a_distance_from_the_nearest_place(view: float, places: list[tuple[float, float]]) -> None:
    cameras = place_cameras(PATH, 2.0, distance=5000.0, count=2, view=view)
    np.testing.assert_allclose(cameras.centre, [(*place, 1000.0) for place in places], atol=0.01)
    middle = np.asarray(project(cameras, jnp.array([[50.0, 2000.0, 1000.0]])))
    np.testing.assert_allclose(middle, 0.0, atol=1e-5)


def test_who_stays_in_place_is_seen_by_the_heading() -> None:
    """Facing -X, a quarter turn about Z from Y: the right side is that of +Y."""
    still = np.tile([0.0, 0.0, 900.0], (3, 1))
    cameras = place_cameras(still, np.pi / 2, distance=3000.0)
    np.testing.assert_allclose(cameras.centre, [[0.0, 3000.0, 900.0]], atol=0.01)


def test_calibrations_see_what_placed_cameras_see() -> None:
    """In pixels, y down, by hand: K (R x + t) over its third entry; and by the cameras that are made of them."""
    cameras = place_cameras(PATH, 0.0, count=3, view=30.0)
    records = records_of_cameras(cameras, 1200.0, (1920, 1080))
    points = np.random.default_rng(0).normal(scale=300.0, size=(5, 3)) + [0.0, 2000.0, 1000.0]
    seen = np.asarray(project(cameras, jnp.asarray(points)), float)
    expected = np.array([960.0, 540.0]) + 1200.0 * seen * [1.0, -1.0]
    for record, pixels in zip(records, expected, strict=True):
        ahead = (points @ record.rotation.T + record.translation) @ record.matrix.T
        np.testing.assert_allclose(ahead[:, :2] / ahead[:, 2:], pixels, atol=0.05)
        np.testing.assert_allclose(record.rotation @ record.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(project(cameras_of_records(records), jnp.asarray(points)), expected, atol=0.05)
