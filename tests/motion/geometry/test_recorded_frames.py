"""Kinematics and projections with NumPy: those of JAX's programs, which they replace where a recording is short."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.footed import footed_body

from poseppl.compilation import double_precision
from poseppl.motion.geometry import Joint, Marker, depth, kinematic_tree, marker_positions, project
from poseppl.motion.geometry.cameras import Cameras, look_at, moved_cameras
from poseppl.motion.geometry.recorded_frames import (
    MarkerKinematics,
    depths,
    image_points,
    image_slopes,
    image_slopes_by_pose,
)

LENSES = {
    "none": None,
    "Brown": [0.1, -0.2, 0.01, -0.02, 0.05],
    "rational": [0.1, -0.2, 0.01, -0.02, 0.05, 0.02, 0.01, -0.01],
    "fisheye": [0.02, -0.01, 0.005, 0.001, 0.0, 0.0, 0.0, 0.0, 1.0],
}
TURNING = kinematic_tree(
    [
        Joint("root", None, (0, 0, 0), "ZYX"),
        Joint("upper", "root", (10, 20, -300), "XYZ"),
        Joint("lower", "upper", (0, 5, -200), "ZX"),
        Joint("hand", "lower", (0, 50, -100), ""),
    ],
    [Marker("elbow", "lower"), Marker("wrist", "hand", (3, -2, 7)), Marker("top", "root", (1, 2, 300))],
)
TREES = {"footed": footed_body().tree, "turns in any order": TURNING}


def double(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), float), tree)


@pytest.mark.parametrize("name", TREES)
def test_places_and_their_derivatives_are_those_of_the_program(name):
    tree = TREES[name]
    poses = np.random.default_rng(0).normal(size=(5, tree.dimension)) * np.where(np.arange(tree.dimension) < 3, 500, 1.0)
    kinematics = MarkerKinematics.of(tree)
    places, moves = kinematics.places_and_moves(poses)
    with double_precision():
        own = double(tree)
        expected = jax.vmap(lambda pose: marker_positions(own, pose))(jnp.asarray(poses))
        slopes = jax.vmap(jax.jacrev(lambda pose: marker_positions(own, pose)))(jnp.asarray(poses))
    assert np.allclose(places, expected, atol=1e-8)
    assert np.allclose(kinematics.places(poses), expected, atol=1e-8)
    assert np.allclose(moves, slopes, atol=1e-8)


@pytest.mark.parametrize("name", LENSES)
def test_projections_and_their_derivatives_are_those_of_the_program(name):
    rng, lens = np.random.default_rng(1), LENSES[name]
    places = rng.normal(size=(4, 6, 3)) * 600
    with double_precision():
        seen = [look_at((0.0, -4000.0, 1000.0), (100.0, 0.0, 0.0)), look_at((3000.0, 500.0, 700.0), (0.0, 0.0, 0.0))]
        cameras: Cameras = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *seen)
        if lens is not None:
            cameras = cameras._replace(distortion=jnp.asarray([lens, 0.5 * np.array(lens)]))
        expected = project(cameras, jnp.asarray(places))
        one = jax.vmap(jax.vmap(jax.jacfwd(lambda place: project(cameras, place))))
        by_place = jnp.moveaxis(one(jnp.asarray(places)), 2, 0)
        nothing = jnp.zeros((2, 6))
        by_pose = jax.jacfwd(lambda e: project(moved_cameras(cameras, e[:, :3], e[:, 3:]), jnp.asarray(places)))(nothing)
        ahead = depth(cameras, jnp.asarray(places))
    points, slopes = image_slopes(cameras, places)
    assert np.allclose(points, expected, atol=1e-10) and np.allclose(image_points(cameras, places), expected, atol=1e-10)
    assert np.allclose(slopes, by_place, rtol=1e-6, atol=1e-10)
    own = np.stack([np.asarray(by_pose)[c, ..., c, :] for c in range(2)])
    assert np.allclose(image_slopes_by_pose(cameras, places), own, rtol=1e-6, atol=1e-9)
    assert np.allclose(depths(cameras, places), ahead, atol=1e-8)


def test_places_behind_a_camera_have_finite_projections_that_do_not_change_with_depth():
    camera = look_at((0.0, 0.0, 0.0), (0.0, 1000.0, 0.0))
    points, slopes = image_slopes(camera, np.array([[10.0, -500.0, 20.0]]))
    assert np.allclose(points, np.asarray(project(camera, jnp.array([[10.0, -500.0, 20.0]]))), rtol=1e-5)
    assert np.allclose(slopes[..., 1], 0.0)
