"""Contour points against the cone that touches an ellipsoid, and what parts hide from the eye."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.sminchisescu_triggs.contours import contour_nodes, hidden
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, part_axes, superquadrics_of
from precision import precision
from superquadric_views import last

from poseppl.motion.geometry import Joint, Marker, kinematic_tree, look_at
from poseppl.motion.geometry.kinematics import frames_of

pytestmark = pytest.mark.full

TREE = kinematic_tree([Joint("hip", None, (0, 0, 0), "ZYX")], [Marker("hip", "hip")])
RINGS, MERIDIANS = np.linspace(-1.2, 1.2, 7), 2 * np.pi * np.arange(12) / 12
DISTANCE, FOCAL = 1000.0, 500.0


def lens():
    return jax.tree.map(lambda leaf: leaf[0][..., None], look_at((0.0, -DISTANCE, 0.0), (0.0, 0.0, 0.0), FOCAL))


def contour(part, state):
    flesh = last(superquadrics_of(TREE, [part], pieces=1))

    def of(state):
        placed = part_axes(flesh, frames_of(last(TREE), state[:, None]))
        return contour_nodes(lens(), flesh, *placed, jnp.asarray(RINGS), jnp.asarray(MERIDIANS))

    return jax.jit(of)(jnp.asarray(state, float))


def test_a_ball_is_seen_as_its_tangent_cone():
    """Radius in the image f r / sqrt(d^2 - r^2) to 0.5 %, longitudes being interpolated; without the cone it is 4 % less."""
    with precision(np.float64):
        found = contour(Superquadric("ball", "hip", (300.0, 300.0, 300.0)), np.zeros(6))
        radius = np.linalg.norm(found.image[0, :, :, 0], axis=1)
        share, normals = np.asarray(found.share[0, :, 0]), np.asarray(found.normals[0, :, :, 0])
        expected = FOCAL * 300 / np.sqrt(DISTANCE**2 - 300**2)
        np.testing.assert_allclose(radius[share > 0.5], expected, rtol=5e-3)
        assert (share > 0.5).sum() >= 10 and expected > 1.04 * FOCAL * 300 / DISTANCE
        outwards = np.asarray(found.image[0, :, :, 0]) / radius[:, None]
        assert np.all(np.sum(outwards * normals, 1)[share > 0.5] > 0.999)


def test_contours_turn_with_a_part():
    """A limb seen from its side has two points a ring, opposite each other; seen from its end, it has none."""
    limb = Superquadric("limb", "hip", (40.0, 40.0, 300.0), (0.4, 1.0))
    side, end = contour(limb, np.zeros(6)), contour(limb, [0, 0, 0, 0, 0, np.pi / 2])
    assert np.all(np.asarray(side.share) > 0.9) and np.asarray(end.share).sum() < 3
    pairs = np.asarray(side.normals[0, :, :, 0]).reshape(-1, 2, 2)
    middle = pairs[1:-1]
    assert np.all(np.sum(middle[:, 0] * middle[:, 1], -1) < -0.9)


def test_points_move_smoothly():
    """Central differences in float64 of the points in the image by the pose; the share's too."""
    limb = Superquadric("limb", "hip", (40.0, 30.0, 200.0), (0.7, 0.9), (0.2, 0.1), 0.2)
    with precision(np.float64):
        flesh = last(superquadrics_of(TREE, [limb], pieces=1))

        def of(state):
            placed = part_axes(flesh, frames_of(last(TREE), state[:, None]))
            found = contour_nodes(lens(), flesh, *placed, jnp.asarray(RINGS), jnp.asarray(MERIDIANS))
            return jnp.concatenate([found.image.ravel(), found.share.ravel()])

        state = jnp.array([10.0, 20.0, -15.0, 0.3, 0.4, 0.2])
        slope, value = np.asarray(jax.jit(jax.jacfwd(of))(state)), jax.jit(of)
        differences = [(value(state + 1e-5 * row) - value(state - 1e-5 * row)) / 2e-5 for row in np.eye(6)]
        np.testing.assert_allclose(slope, np.stack(differences, 1), atol=1e-5 * np.abs(slope).max())


def test_what_is_behind_another_part_is_hidden():
    """A ball behind another one is; beside it, in front of it and by itself it is not. Points inside another part are."""
    parts = [Superquadric(name, "hip", (50.0, 50.0, 50.0)) for name in ("front", "back")]
    flesh = last(superquadrics_of(TREE, parts, pieces=1))
    axes = jnp.tile(jnp.eye(3)[None, :, :, None], (2, 1, 1, 1))
    eye = jnp.array([0.0, -DISTANCE, 0.0])[:, None]

    def share(centre, point, part=1):
        centres = jnp.stack([jnp.zeros(3), jnp.asarray(centre, float)])[:, :, None]
        points = jnp.tile(jnp.asarray(point, float)[None, None, :, None], (2, 1, 1, 1))
        return float(hidden(flesh, axes, centres, eye, points, 5.0)[part, 0, 0])

    assert share((0, 300, 0), (0, 250, 0)) > 0.999
    assert share((0, -300, 0), (0, -350, 0)) < 1e-3 and share((200, 300, 0), (200, 250, 0)) < 1e-3
    assert share((0, 300, 0), (0, -50, 0), part=0) < 1e-3
    assert share((0, 300, 0), (0, 0, 0)) > 0.99
    assert 0.4 < share((0, 1000, 0), (100, 1000, 0)) < 0.6  # the way passes 50 mm beside the front one's centre
