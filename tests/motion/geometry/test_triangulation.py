"""Rays, distances between them, and places, against projections of known points."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.motion.geometry import Cameras, join_cameras, look_at, project
from poseppl.motion.geometry.cameras import nearest_points, ray_distances, viewing_rays

POINTS = np.random.default_rng(0).uniform(-400, 400, (20, 3)) + [0, 0, 1000]


@pytest.fixture
def cameras() -> Cameras:
    two = join_cameras([look_at((0, -4000, 1500), (0, 0, 1000), 1000.0), look_at((3500, -1500, 800), (0, 0, 1000), 1200.0)])
    return two._replace(distortion=jnp.array([[-0.2, 0.05, 0.001, -0.002, 0.01], [0.1, 0.0, 0.0, 0.001, 0.0]]))


@pytest.mark.full
def test_rays_pass_by_what_was_projected(cameras: Cameras) -> None:
    image = np.asarray(project(cameras, jnp.asarray(POINTS)), np.float64)
    for camera in range(2):
        rays = viewing_rays(cameras, camera, image[camera])
        offset = POINTS - np.asarray(cameras.centre[camera], np.float64)
        assert np.linalg.norm(np.cross(offset, rays), axis=-1).max() < 0.05  # mm at 4 m, of seven digits
        bent = viewing_rays(cameras._replace(distortion=None), camera, image[camera])
        assert np.linalg.norm(np.cross(offset, bent), axis=-1).max() > 1.0


@pytest.mark.full
def test_places_are_where_rays_meet(cameras: Cameras) -> None:
    image = np.asarray(project(cameras, jnp.asarray(POINTS)), np.float64)
    image[0, 3] = np.nan
    rays = np.stack([viewing_rays(cameras, camera, image[camera]) for camera in range(2)])
    centres = np.asarray(cameras.centre, np.float64)
    apart = ray_distances(centres[0], rays[0], centres[1], rays[1])
    assert np.nanmax(apart) < 0.1
    assert np.isnan(apart[3])
    wrong = ray_distances(centres[0], rays[0], centres[1], np.roll(rays[1], 1, 0))
    assert np.nanmedian(wrong) > 50
    places = nearest_points(centres, rays, np.isfinite(rays).all(-1).astype(float))
    assert np.isnan(places[3]).all()
    np.testing.assert_allclose(np.delete(places, 3, 0), np.delete(POINTS, 3, 0), atol=0.1)


@pytest.mark.full
def test_a_place_between_rays_is_pulled_to_the_heavier_ones() -> None:
    centres = np.array([[0.0, 0, 0], [0, 0, 10], [0, 100, 0]])
    rays = np.array([[[1.0, 0, 0]], [[1.0, 0, 0]], [[0, -1.0, 0]]])
    place = nearest_points(centres, rays, np.array([[1.0], [3.0], [1.0]]))[0]
    # # the first two determine y, all three z: 3 * 10 / 5
    np.testing.assert_allclose(place, [0.0, 0.0, 6.0], atol=1e-9)
