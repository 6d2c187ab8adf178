"""Superquadrics: their surfaces against the inequality they solve, gradients, and what is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import JOINTS, mixed_tree, plain_kinematics, states
from oracles.plain_superquadrics import is_inside
from precision import epsilon, precision
from superquadric_views import TREE, frame_of, last, placed_nodes, pose, random_part

from poseppl.motion.geometry import Marker
from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.geometry.superquadrics import Superquadric, local_nodes, part_axes, place_in, superquadrics_of

SIZE = 3000.0  # mm: tolerances in mm are this times the rounding
PARTS = (
    Superquadric("egg", "hip", (60.0, 50.0, 150.0), taper=(0.3, 0.2), centre=(-200.0, 0.0, 0.0)),
    Superquadric("banana", "hip", (45.0, 45.0, 200.0), bend=0.9, bend_towards=0.7, axis=(1, 2, 2), across=(0, 1, 0)),
    Superquadric("box", "hip", (90.0, 70.0, 60.0), (0.4, 0.5), centre=(200.0, 50.0, 0.0)),
)


def nodes_in_place(part, latitudes, longitudes):
    """Points and normals (R, W, 3) in the part's frame."""
    nodes = placed_nodes(superquadrics_of(TREE, [part]), jnp.asarray(latitudes), jnp.asarray(longitudes))
    return (np.asarray(leaf)[0, ..., 0] for leaf in nodes)


def test_surfaces_solve_the_inequality():
    """Half a millimetre out along the normal is outside, as much in is inside; with 2 mm of 50 too much taper, not."""
    rng = np.random.default_rng(0)
    with precision(np.float64):
        for _ in range(20):
            part = random_part(rng)
            points, normals = nodes_in_place(part, rng.uniform(-1.55, 1.55, 30), rng.uniform(0, 6.28, 30))
            assert is_inside(points - 0.5 * normals, part).all() and not is_inside(points + 0.5 * normals, part).any()
            wrong = part._replace(taper=(part.taper[0] + 0.04, part.taper[1]))
            assert not is_inside(points - 0.5 * normals, wrong).all() or is_inside(points + 0.5 * normals, wrong).any()


def test_normals_stand_on_the_surface():
    """Exact up to central differences: tangents of steps of 1e-6 in the angles are known to 1e-6 or so of their length."""
    rng = np.random.default_rng(1)
    with precision(np.float64):
        for _ in range(5):
            part, step = random_part(rng), 1e-6
            eta, omega = rng.uniform(-1.4, 1.4, 15), rng.uniform(0.1, 1.4, 15)
            _, normals = nodes_in_place(part, eta, omega)
            for turn in ((step, 0.0), (0.0, step)):
                ends = [next(nodes_in_place(part, eta + sign * turn[0], omega + sign * turn[1])) for sign in (1, -1)]
                tangent = ends[0] - ends[1]
                lean = np.sum(tangent * normals, -1) / np.linalg.norm(tangent, axis=-1)
                assert np.abs(lean).max() < 1e-5
            np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-12)


def test_bending_makes_arcs_and_nothing_of_no_angle():
    with precision(np.float64):
        rod = Superquadric("rod", "hip", (20.0, 20.0, 300.0), bend=1.0, bend_towards=np.pi / 2)
        points, _ = nodes_in_place(rod, [-np.pi / 2, np.pi / 2], [0.0])
        radius = 600.0  # of an arc of 600 mm and one radian
        expected = [[0.0, radius * (1 - np.cos(0.5)), sign * radius * np.sin(0.5)] for sign in (-1, 1)]
        np.testing.assert_allclose(points[:, 0], expected, atol=1e-9)
        angles = np.linspace(-1.5, 1.5, 9), np.linspace(0, 6, 9)
        straight, hardly = (next(nodes_in_place(rod._replace(bend=bend), *angles)) for bend in (0.0, 1e-12))
        np.testing.assert_allclose(straight, hardly, atol=1e-8)


def test_ellipsoids_are_by_the_book():
    with precision(np.float64):
        eta, omega = np.linspace(-1.5, 1.5, 7), np.linspace(0, 6, 9)
        points, _ = nodes_in_place(Superquadric("ball", "hip", (30.0, 40.0, 50.0)), eta, omega)
        level, around = np.meshgrid(eta, omega, indexing="ij")
        expected = [30 * np.cos(level) * np.cos(around), 40 * np.cos(level) * np.sin(around), 50 * np.sin(level)]
        np.testing.assert_allclose(points, np.stack(expected, -1), atol=1e-9)


def test_parts_are_where_markers_of_the_same_offsets_are(dtype):
    tree = mixed_tree()
    part = Superquadric("slant", "wheel", (50.0, 40.0, 90.0), centre=(10.0, -20.0, 30.0), axis=(1, 2, 3), across=(0, 0, 1))
    flesh = last(superquadrics_of(tree, [part]))
    axes, centre = frame_of(part, np.zeros(6))
    markers = [Marker(f"end{sign}", "wheel", tuple(centre + sign * 90.0 * axes[:, 2])) for sign in (-1, 1)]
    poles = jnp.array([-0.5, 0.5], dtype) * np.pi
    for state in states(tree, 5):
        axes = part_axes(flesh, frames_of(last(tree), jnp.asarray(state, dtype)[:, None]))
        found = place_in(*axes, local_nodes(flesh, poles, jnp.zeros(1, dtype)))
        expected = plain_kinematics(JOINTS, markers, state)
        np.testing.assert_allclose(found.points[0, :, 0, :, 0], expected, atol=20 * SIZE * epsilon(dtype))
        outwards = np.diff(expected, axis=0)[0] / 180.0
        np.testing.assert_allclose(found.normals[0, :, 0, :, 0], [-outwards, outwards], atol=50 * epsilon(dtype))


def test_gradients_of_points_by_state_and_shape_against_finite_differences():
    """Exact up to central differences: nine parameters of each shape, and six of the pose."""
    rng = np.random.default_rng(7)
    with precision(np.float64):
        flesh = last(superquadrics_of(TREE, PARTS))
        angles = jnp.asarray(rng.uniform(-1.5, 1.5, 6)), jnp.asarray(rng.uniform(0, 6.2, 5))
        weights = [jnp.asarray(rng.normal(size=(3, 6, 5, 3, 1))) for _ in range(2)]

        @jax.jit
        def score(moving):
            state, *shapes = moving
            changed = jax.tree.unflatten(jax.tree.structure(flesh), [*jax.tree.leaves(flesh)[:2], *shapes])
            nodes = place_in(*part_axes(changed, frames_of(last(TREE), state)), local_nodes(changed, *angles))
            return sum(jnp.sum(w * leaf) for w, leaf in zip(weights, (nodes.points, 100 * nodes.normals), strict=True))

        start = [jnp.asarray(pose(rng))[:, None], *jax.tree.leaves(flesh)[2:]]
        found = jax.jit(jax.grad(score))(start)
        for number, leaf in enumerate(start):
            for place in np.ndindex(leaf.shape):
                step = 1e-6 * max(1.0, abs(float(leaf[place])))
                ends = [score([*start[:number], leaf.at[place].add(sign * step), *start[number + 1 :]]) for sign in (1, -1)]
                np.testing.assert_allclose(found[number][place], (ends[0] - ends[1]) / (2 * step), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"joint": "hand"}, "'new' rides on joint 'hand'; expected one of"),
        ({"name": "egg"}, "two parts are named 'egg'"),
        ({"half_axes": (0.0, 1.0, 2.0)}, "'new' has half-axes"),
        ({"half_axes": (np.inf, 1.0, 2.0)}, "'new' has half-axes"),
        ({"exponents": (0.05, 1.0)}, "'new' has exponents"),
        ({"exponents": (1.0, 2.1)}, "'new' has exponents"),
        ({"taper": (0.0, -1.0)}, "'new' has a taper"),
        ({"bend": 3.5}, "'new' is bent by 3.5 rad"),
        ({"bend": 1.5, "half_axes": (100.0, 50.0, 60.0)}, "expected less than 1.2"),
        ({"across": (0.0, 0.0, 2.0)}, "'new' has its x along its axis"),
    ],
)
def test_what_is_no_part(change, words):
    with pytest.raises(ValueError, match=words):
        superquadrics_of(TREE, [PARTS[0], Superquadric("new", "hip", (10.0, 20.0, 30.0))._replace(**change)])
    with pytest.raises(ValueError, match="at least one part"):
        superquadrics_of(TREE, [])
