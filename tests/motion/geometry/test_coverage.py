"""Silhouettes against rays, their softening, and batches."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from cone_views import CONES, TREE, camera, covered, four_cameras, last, overlap, pose, silhouettes
from precision import precision

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.coverage import (
    hard_coverage,
    limb_corners,
    outline_corners,
    part_distances,
    project_parts,
    soft_coverage,
)
from poseppl.motion.geometry.flesh import flesh_of, parts_of, sphere

BENT = (-0.32, 0.15, 0.0, 0.0, 0.0)
"""Lens distortion of the bodytrack benchmark's cameras."""


@pytest.mark.full
@pytest.mark.parametrize("distance", [5000.0, 2500.0, 1000.0])
@pytest.mark.parametrize("name", CONES)
def test_silhouettes_agree_with_rays(name, distance):
    """Discretisation: over 0.99 of the union; 0.9999 is seen near by, less where rings seen from their side are 0.5 px thick.

    200 points across determine an overlap to about 0.001. Radii that are off by a tenth must be detected.
    """
    rng = np.random.default_rng(int(distance))
    with precision(np.float64):
        for _ in range(4):
            view = camera(distance, rng.uniform(-0.5, 0.9), rng.uniform(0, 6))
            state = pose(rng, distance / 60)
            found, expected = silhouettes(CONES[name], state, view)
            assert expected.mean() > 0.03
            assert overlap(found, expected) > 0.99
            thin = CONES[name]._replace(radii=tuple(0.9 * radius for radius in CONES[name].radii))
            assert overlap(silhouettes(thin, state, view, window=CONES[name])[0], expected) < 0.99


@pytest.mark.full
def test_silhouettes_through_a_bent_lens():
    """To first order: a lens bends the edges of a part that fills the image. 0.98 at 1.5 m, over 0.99 at 3 m."""
    rng = np.random.default_rng(0)
    with precision(np.float64):
        for distance, least in ((3000.0, 0.99), (1500.0, 0.98)):
            for name in ("torso", "flat", "tapered"):
                found, expected = silhouettes(CONES[name], pose(rng, distance / 30), camera(distance, distortion=BENT))
                assert overlap(found, expected) > least, (distance, name)


@pytest.mark.full
def test_far_edges_are_those_of_the_short_formula():
    """The benchmark's corners are the exact ones of a far cylinder: their distance falls as 1 / distance, or faster."""
    with precision(np.float64):
        flesh = last(flesh_of(TREE, [CONES["cylinder"]]))
        parts = parts_of(last(TREE), flesh, jnp.array([20.0, 30.0, -10.0, 0.3, 0.4, -0.5])[:, None])
        errors = []
        for distance in (2e3, 2e4):
            view = last(camera(distance))
            gap = limb_corners(view, flesh, parts) - outline_corners(view, flesh, parts)
            errors.append(float(jnp.abs(gap).max()) * distance / 600.0)  # mm at the cylinder
        assert errors[0] > 0.5 and errors[1] < errors[0] / 8


@pytest.mark.full
def test_spheres():
    """The image of a sphere: points whose rays pass within its radius, however near it is."""
    rng = np.random.default_rng(1)
    with precision(np.float64):
        for distance in (4000.0, 800.0, 300.0):
            flesh = last(flesh_of(TREE, [sphere("ball", "hip", 110.0, (30.0, -20.0, 50.0))]))
            state = jnp.asarray(pose(rng, distance / 100))
            parts, view = parts_of(last(TREE), flesh, state[:, None]), camera(distance, rng.uniform(-0.5, 0.9))
            eye, turn = np.asarray(view.centre[0]), np.asarray(view.rotation[0])
            centre = turn @ (np.asarray(parts.base + parts.tip)[0, :, 0] / 2 - eye)
            reach = 1.5 * 110.0 / np.sqrt(centre @ centre - 110.0**2)
            grid = np.stack(np.meshgrid(*[np.linspace(-reach, reach, 200)] * 2), -1).reshape(-1, 2) + centre[:2] / centre[2]
            rays = np.concatenate([grid, np.ones((len(grid), 1))], 1)
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            expected = np.linalg.norm(centre - (rays @ centre)[:, None] * rays, axis=1) < 110.0
            points = jnp.asarray(600.0 * grid + [320.0, 240.0])[None]
            found = covered(last(view), flesh, parts, points)[0]
            assert 0.05 < expected.mean() < 0.9
            assert overlap(np.asarray(found), expected) > 0.995


def side_by_side():
    return flesh_of(TREE, [cone._replace(origin=(150.0 * i - 300.0, 0.0, 0.0)) for i, cone in enumerate(CONES.values())])


def body_distances(state, points):
    """Distances (C, P, K) of one state (6,) from points (C, K, 2)."""

    def function(tree, flesh, state, cameras, points):
        return part_distances(project_parts(cameras, flesh, parts_of(tree, flesh, state)), points)

    return batch_last(function)(TREE, side_by_side(), state, four_cameras(), points)


def image_points(rng, count):
    return jnp.asarray(rng.uniform((180, 120), (460, 360), (4, count, 2)))


@pytest.mark.full
def test_soft_coverage_tends_to_the_hard_one():
    """Discretisation: the mean gap is proportional to the softness, the share of points that are so near an edge."""
    rng = np.random.default_rng(2)
    with precision(np.float64):
        distances = body_distances(jnp.asarray(pose(rng)), image_points(rng, 4000))[..., None]
        hard = np.asarray(hard_coverage(distances))
        assert 0.05 < hard.mean() < 0.95
        softness = np.array([2.0, 1.0, 0.5, 0.25])
        gaps = []
        for width in softness:
            soft = 1 - np.exp(np.asarray(soft_coverage(distances, jnp.full((4, 1), width))))
            gaps.append(np.abs(soft - hard).mean())
    rate = np.polyfit(np.log(softness), np.log(gaps), 1)[0]
    assert 0.85 < rate < 1.15, gaps


@pytest.mark.full
def test_gradients_against_finite_differences():
    """Exact up to central differences: steps of 1e-5 leave some 1e-8 of the gradient in float64."""
    rng = np.random.default_rng(3)
    with precision(np.float64):
        points = image_points(rng, 50)

        cameras, flesh, weights = last(four_cameras()), last(side_by_side()), jnp.cos(jnp.arange(50.0))[:, None]

        @jax.jit
        def scores(states):  # (6, N), the batch last
            shapes = project_parts(cameras, flesh, parts_of(last(TREE), flesh, states))
            return jnp.sum(weights * soft_coverage(part_distances(shapes, points[..., None]), jnp.full((4, 1), 3.0)), (0, 1))

        state = jnp.asarray(pose(rng))[:, None]
        found = np.asarray(jax.jit(jax.grad(lambda x: scores(x)[0]))(state))[:, 0]
        steps = 1e-5 * jnp.eye(6)
        expected = np.asarray(scores(state + steps) - scores(state - steps)) / 2e-5
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
        assert np.all(np.abs(found) > 1e-4)


@pytest.mark.slow
def test_gradients_are_finite_seen_along_an_axis_and_from_behind(dtype):
    """Cases without edges: the eye on the axis, inside a part, and the part behind the camera."""
    points = image_points(np.random.default_rng(4), 30)[:1].astype(dtype)

    @jax.jit
    @jax.value_and_grad
    def score(state, flesh, view):
        shapes = project_parts(view, flesh, parts_of(last(TREE), flesh, state[:, None]))
        return jnp.sum(soft_coverage(part_distances(shapes, points[..., None]), jnp.full((1, 1), 2.0)))

    for distance, place in ((3000.0, 0.0), (100.0, 0.0), (3000.0, -6000.0)):
        view = last(camera(distance, elevation=0.0))
        for cone in (*CONES.values(), sphere("ball", "hip", 90.0)):
            flesh = last(flesh_of(TREE, [cone._replace(name="part", axis=(0, 1, 0), across=(1, 0, 0))]))
            value, gradient = score(jnp.array([0.0, place, 0.0, 0.0, 0.0, 0.0], dtype), flesh, view)
            assert np.isfinite(value) and np.all(np.isfinite(gradient)), (distance, place, cone.name)


@pytest.mark.full
def test_a_batch_is_one_at_a_time(dtype):
    """Exact up to rounding; distances of several hundred px in float32 are known to 1e-3 px or so."""
    rng = np.random.default_rng(5)
    states, points = jnp.asarray(np.stack([pose(rng) for _ in range(11)]), dtype), image_points(rng, 20).astype(dtype)
    together = jax.vmap(lambda state: body_distances(state, points))(states)
    alone = jax.jit(lambda state: body_distances(state, points))
    single = jnp.stack([alone(state) for state in states])
    np.testing.assert_allclose(together, single, rtol=1e-3 if dtype == np.float32 else 1e-9, atol=1e4 * np.finfo(dtype).eps)
