"""Implicit surfaces against points sampled on them, against Barr's inequality in plain NumPy, and their repulsion."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.superquadric_rays import is_inside
from poseppl_models.sminchisescu_triggs.non_penetration import penetration, surface_distances
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, superquadrics_of
from precision import precision
from superquadric_views import TREE, last, local_points, random_part

_DISTANCES = jax.jit(surface_distances)


def distances(part, points):
    """f (K,) at points (K, 3) of the part's frame."""
    return np.asarray(_DISTANCES(last(superquadrics_of(TREE, [part], pieces=1)), jnp.asarray(points)[None, ..., None])[0, :, 0])


@pytest.mark.full
def test_sampled_surfaces_are_where_it_is_zero():
    """Exact in float64 for 20 random shapes; 2 mm off with a wrong taper."""
    rng = np.random.default_rng(0)
    with precision(np.float64):
        for _ in range(20):
            part = random_part(rng)
            eta, omega = rng.uniform(-1.5, 1.5, 12), rng.uniform(0, 6.28, 12)
            points = local_points(superquadrics_of(TREE, [part], pieces=1), eta, omega).reshape(-1, 3)
            np.testing.assert_allclose(distances(part, points), 0, atol=1e-6)
            wrong = part._replace(taper=(part.taper[0] + 0.1, part.taper[1]))
            assert np.abs(distances(wrong, points)).max() > 0.5


def test_its_sign_solves_the_inequality():
    """At points all around, inside and outside, beyond the ends of bent and tapered parts too: Barr's inequality, unbent."""
    rng = np.random.default_rng(1)
    with precision(np.float64):
        for _ in range(20):
            part = random_part(rng)
            points = rng.uniform(-1.2, 1.2, (400, 3)) * np.array(part.half_axes)
            found = distances(part, points)
            sure = np.abs(found) > 1e-6
            inside = is_inside(points, part)
            assert 20 < inside.sum() < 380
            assert np.array_equal(found[sure] < 0, inside[sure])


@pytest.mark.full
def test_it_is_no_more_than_the_distance():
    """An ellipsoid, by 4,000 points of its surface: |f| is at most the distance, and at least half of it near by."""
    rng = np.random.default_rng(2)
    part = Superquadric("egg", "hip", (50.0, 60.0, 90.0))
    directions = rng.normal(size=(4000, 3))
    surface = directions / np.linalg.norm(directions, axis=1, keepdims=True) * part.half_axes
    points = surface[:200] * rng.uniform(0.8, 1.2, (200, 1))
    true = np.linalg.norm(points[:, None] - surface, axis=2).min(1)
    with precision(np.float64):
        found = np.abs(distances(part, points))
    assert np.all(found <= true + 1e-6) and np.all(found >= 0.5 * true - 2.0)  # samples are up to 4 mm apart


@pytest.mark.full
def test_gradients():
    """Central differences in float64, on the axes too, where powers have kinks."""
    part = Superquadric("limb", "hip", (50.0, 40.0, 150.0), (0.6, 0.9), (0.2, -0.1), 0.4, 0.3)
    points = np.array([[60.0, 10.0, 30.0], [-20.0, 15.0, -160.0], [5.0, -70.0, 0.5], [30.0, 30.0, 170.0]])
    with precision(np.float64):
        gradient = jax.grad(lambda p: jnp.sum(_DISTANCES(last(superquadrics_of(TREE, [part], pieces=1)), p[None, ..., None])))
        steps = [distances(part, points + 1e-5 * row) - distances(part, points - 1e-5 * row) for row in np.eye(3)]
        np.testing.assert_allclose(gradient(jnp.asarray(points)), np.stack(steps, 1) / 2e-5, atol=1e-6)
        assert np.isfinite(gradient(jnp.zeros((1, 3)))).all()


@pytest.mark.full
@pytest.mark.parametrize("decay", [1.0, 2.0, 3.0])
def test_repulsion(decay):
    """One node 59 mm inside of a ball to 40 mm outside: exp(-f |f|^(p - 1)), its tangent beyond e^8; a gradient inside."""
    flesh = last(superquadrics_of(TREE, [Superquadric("ball", "hip", (60.0, 60.0, 60.0))], pieces=1))

    @jax.jit
    def potential(height):
        points = jnp.zeros((1, 1, 3, 1)).at[:, :, 2].set(60.0 + height)
        return penetration(flesh, points, softness=15.0, decay=decay)[0, 0]

    slope = jax.jit(jax.grad(potential))
    for height in (-59.0, -40.0, -10.0, 0.0, 5.0, 40.0):
        exponent = -height / 15 * abs(height / 15) ** (decay - 1)
        expected = np.exp(min(exponent, 8)) * (1 + max(exponent - 8, 0))
        np.testing.assert_allclose(potential(height), expected, rtol=1e-4)
        assert height > -5 or slope(height) < -1e-3
