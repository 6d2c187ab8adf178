"""Distances of capsules against bounded least squares, and constraints of the published bodies."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.darby.body import darby_body
from poseppl_models.du_guan.likelihood import du_guan_body
from poseppl_models.images.image_program import Capsules, clearances, part_capsules, parts_apart, rejected, within_limits
from poseppl_models.peursum.body import peursum_body
from precision import precision
from scipy.optimize import lsq_linear

from poseppl.motion.geometry.flesh import part_frames

BODIES = {"darby": (darby_body, 31, 10), "du_guan": (du_guan_body, 24, 14), "peursum": (peursum_body, 28, 12)}


def nearest_by_least_squares(one, other):
    """Distance of two segments: the least squares of the gap over both parameters, each from 0 to 1."""
    directions = np.stack([one[1] - one[0], other[0] - other[1]], 1)
    return np.sqrt(2 * lsq_linear(directions, other[0] - one[0], (0, 1), method="bvls").cost)


@pytest.mark.full
def test_clearance_is_the_least_distance():
    """Random, crossing, parallel and collinear segments."""
    rng = np.random.default_rng(0)
    ends = rng.normal(0, 300, (30, 2, 2, 3))
    ends[0, 1] = ends[0, 0] + [50.0, 0.0, 0.0]
    ends[1, 1] = ends[1, 0] + 1.5 * (ends[1, 0, 1] - ends[1, 0, 0])
    ends[2] = [[[0, 0, 0], [100, 0, 0]], [[50, -50, 0], [50, 50, 0]]]
    with precision(np.float64):
        start, end = (jnp.asarray(np.moveaxis(ends[:, :, k], 0, -1)) for k in range(2))
        found = clearances(Capsules(start, end, jnp.array([[20.0], [30.0]])), ((0, 1),))[0]
    expected = [nearest_by_least_squares(*pair) - 50.0 for pair in ends]
    np.testing.assert_allclose(found, expected, atol=1e-3)  # ours adds 3e-5 mm where segments meet, for a gradient there


@pytest.mark.full
def test_factors():
    clearance = jnp.array([[5.0, -3.0], [1.0, 8.0]])
    assert rejected(clearance).tolist() == [0.0, -np.inf] and rejected(clearance, 3.5).tolist() == [0.0, 0.0]


@pytest.mark.full
@pytest.mark.parametrize("name", BODIES)
def test_published_bodies(name):
    """Degrees of freedom and parts; at ease nothing is violated, and inner capsules lie within the outer ones."""
    build, dimension, parts = BODIES[name]
    body = build()
    assert body.tree.dimension == dimension and len(body.flesh.names) == parts
    place = part_frames(body.tree, body.flesh, jnp.asarray(body.rest, float))
    soles = min(float(point[2]) for point in np.concatenate([place.base, place.tip]))
    crown = max(float(point[2]) for point in np.concatenate([place.base, place.tip]))
    assert -10 < soles < 90 and 1600 < crown < 1760
    assert [float(factor(body, jnp.asarray(body.rest, float), {})) for factor in (within_limits, parts_apart)] == [0.0, 0.0]
    last = jax.tree.map(lambda leaf: leaf[..., None], (body.flesh, place))
    inside, around = (part_capsules(*last, kind) for kind in ("inside", "around"))
    assert np.all(np.asarray(inside.radius) <= np.asarray(around.radius))
    assert np.all(np.asarray(clearances(inside, body.apart)) >= np.asarray(clearances(around, body.apart)) - 1e-2)  # float32 mm


@pytest.mark.full
def test_impossible_poses_are_rejected():
    """A knee bent forwards, and a forearm within the torso; poses of limbs that only come near are not."""
    body = darby_body()
    index = {coordinate: i for i, coordinate in enumerate(body.tree.coordinates)}

    def value(factor, **changes):
        state = np.array(body.rest)
        for key, angle in changes.items():
            state[index[tuple(key.rsplit("_", 1))]] = angle
        return float(factor(body, jnp.asarray(state, float), {}))

    assert value(within_limits, knee_l_X=0.5) == -np.inf
    crossed = {"shoulder_l_Y": -0.2, "shoulder_l_Z": -1.2, "elbow_l_X": 1.6}
    assert value(parts_apart, **crossed) == -np.inf
    assert value(parts_apart, elbow_l_X=1.6) == 0.0
