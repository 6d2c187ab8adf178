"""Superquadrics: their surfaces against the inequality they solve, silhouettes against rays, gradients, and what is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import JOINTS, mixed_tree, plain_kinematics, states
from cone_views import camera, four_cameras, overlap
from oracles.superquadric_rays import is_inside
from poseppl_models.sminchisescu_triggs.superquadric_outlines import Fineness, contour_points, facing, outlines_of
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, nodes_of, superquadrics_of, surface_nodes
from precision import epsilon, precision
from superquadric_views import TREE, distances_of, frame_of, last, placed_nodes, pose, random_part, silhouettes

from poseppl.motion.geometry import Marker
from poseppl.motion.geometry.batch_last import batched_score
from poseppl.motion.geometry.coverage import hard_coverage, soft_coverage

SIZE = 3000.0  # mm: tolerances in mm are this times the rounding
BENT = (-0.32, 0.15, 0.0, 0.0, 0.0)
"""Lens distortion of the bodytrack benchmark's cameras."""
PARTS = (
    Superquadric("egg", "hip", (60.0, 50.0, 150.0), taper=(0.3, 0.2), centre=(-200.0, 0.0, 0.0)),
    Superquadric("banana", "hip", (45.0, 45.0, 200.0), bend=0.9, bend_towards=0.7, axis=(1, 2, 2), across=(0, 1, 0)),
    Superquadric("box", "hip", (90.0, 70.0, 60.0), (0.4, 0.5), centre=(200.0, 50.0, 0.0)),
)


def nodes_in_place(part, latitudes, longitudes):
    """Points and normals (R, W, 3) in the part's frame."""
    nodes = placed_nodes(superquadrics_of(TREE, [part], pieces=1), jnp.asarray(latitudes), jnp.asarray(longitudes))
    return (np.asarray(leaf)[0, ..., 0] for leaf in nodes)


@pytest.mark.full
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


@pytest.mark.full
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


@pytest.mark.full
def test_parts_are_where_markers_of_the_same_offsets_are(dtype):
    tree = mixed_tree()
    part = Superquadric("slant", "wheel", (50.0, 40.0, 90.0), centre=(10.0, -20.0, 30.0), axis=(1, 2, 3), across=(0, 0, 1))
    flesh = superquadrics_of(tree, [part])
    axes, centre = frame_of(part, np.zeros(6))
    markers = [Marker(f"end{sign}", "wheel", tuple(centre + sign * 90.0 * axes[:, 2])) for sign in (-1, 1)]
    poles = jnp.array([-0.5, 0.5], dtype) * np.pi
    for state in states(tree, 5):
        found = surface_nodes(tree, flesh, jnp.asarray(state, dtype), poles, jnp.zeros(1, dtype))
        expected = plain_kinematics(JOINTS, markers, state)
        np.testing.assert_allclose(found.points[0, :, 0], expected, atol=20 * SIZE * epsilon(dtype))
        outwards = np.diff(expected, axis=0)[0] / 180.0
        np.testing.assert_allclose(found.normals[0, :, 0], [-outwards, outwards], atol=50 * epsilon(dtype))


@pytest.mark.full
@pytest.mark.parametrize("distance", [5000.0, 1500.0])
def test_silhouettes_agree_with_rays(distance):
    """Discretisation: over 0.99 of the union. A part without its taper, or its bend, must be detected if they are large."""
    rng = np.random.default_rng(int(distance))
    with precision(np.float64):
        for number in range(6):
            part, state = random_part(rng), pose(rng, distance / 60)
            view = camera(distance, rng.uniform(-0.5, 0.9), rng.uniform(0, 6))
            found, expected = silhouettes(part, state, view)
            assert expected.mean() > 0.1
            assert overlap(found, expected) > 0.99, (number, part)
            if max(map(abs, part.taper)) > 0.3:
                straight = part._replace(taper=(0.0, 0.0))
                assert overlap(silhouettes(part, state, view, wrong=straight)[0], expected) < 0.99


@pytest.mark.full
def test_silhouettes_of_bent_parts_are_hollow():
    """A quarter of a circle seen from the side: with one convex piece in the place of many the hollow would be filled."""
    with precision(np.float64):
        part = Superquadric("hook", "hip", (40.0, 40.0, 240.0), bend=1.5, axis=(0, 0, 1))
        state, view = np.zeros(6), camera(3000.0, 0.0)
        found, expected = silhouettes(part, state, view, pieces=None)
        assert overlap(found, expected) > 0.99
        assert overlap(silhouettes(part, state, view, pieces=1)[0], expected) < 0.8


@pytest.mark.full
def test_silhouettes_through_a_bent_lens():
    """All nodes are seen through the lens, so that it costs nothing."""
    rng = np.random.default_rng(2)
    with precision(np.float64):
        for _ in range(3):
            found, expected = silhouettes(random_part(rng), pose(rng, 40.0), camera(1500.0, distortion=BENT))
            assert overlap(found, expected) > 0.99


@pytest.mark.full
def test_contours_of_ellipsoids_lie_in_planes():
    """An eye e sees an ellipsoid's contour in the plane (p - c)' A (e - c) = 1; crossings come nearer as the squared step."""
    with precision(np.float64):
        part, state, view = Superquadric("ball", "hip", (60.0, 90.0, 120.0)), pose(np.random.default_rng(3)), camera(700.0)
        axes, centre = frame_of(part, state)
        eye = (np.asarray(view.centre[0]) - centre) @ axes / np.array(part.half_axes) ** 2
        errors = []
        for count in (12, 36):
            angles = jnp.linspace(-np.pi / 2, np.pi / 2, count + 1), jnp.linspace(0, 2 * np.pi, 2 * count, endpoint=False)
            nodes = jax.jit(nodes_of)(last(TREE), last(superquadrics_of(TREE, [part])), jnp.asarray(state)[:, None], *angles)
            contours = jax.jit(contour_points)(last(view), nodes)
            on = np.asarray(contours.on)[0, 0, :, 0] > 0
            assert on.sum() >= count
            points = (np.asarray(contours.points)[0, 0, on, :, 0] - centre) @ axes
            errors.append(np.abs(points @ eye - 1).max())
            seen = np.asarray(facing(last(view), nodes)) > 0
            assert 0.2 < seen.mean() < 0.5  # a near eye sees less than half
        assert errors[1] < errors[0] / 6, errors


@pytest.mark.full
def test_contours_lie_on_silhouettes():
    """In the image their distance from the silhouette is within a hundredth of the part; other nodes are inside or on it."""
    with precision(np.float64):
        part, state, view = PARTS[0], pose(np.random.default_rng(4)), camera(2500.0, distortion=BENT)
        flesh = last(superquadrics_of(TREE, [part]))
        state = jnp.asarray(state)[:, None]
        angles = jnp.linspace(-np.pi / 2, np.pi / 2, 25), jnp.linspace(0, 2 * np.pi, 32, endpoint=False)
        contours = jax.jit(contour_points)(last(view), jax.jit(nodes_of)(last(TREE), flesh, state, *angles))
        distances = jax.jit(distances_of)(last(view), flesh, last(TREE), state, contours.image[:, 0])[0, 0, :, 0]
        on = np.asarray(contours.on)[0, 0, :, 0] > 0
        size = 600.0 * 150.0 / 2500.0
        assert on.sum() > 30 and np.abs(np.asarray(distances)[on]).max() < 0.02 * size
        assert np.asarray(distances).max() < 0.02 * size


def body_score(state, cameras, flesh, tree, points):
    """A smooth score (N,) of states (6, N): weighted log-probabilities that points are not covered."""
    distances = distances_of(cameras, flesh, tree, state, points)
    weights = jnp.cos(jnp.arange(distances.shape[2], dtype=distances.dtype))[:, None]
    return jnp.sum(weights * soft_coverage(distances, jnp.full((4, 1), 3.0, distances.dtype)), (0, 1))


def image_points(rng, count):
    return jnp.asarray(rng.uniform((260, 180), (380, 300), (4, count, 2)))


@pytest.mark.full
def test_soft_coverage_tends_to_the_hard_one():
    """Discretisation: the mean gap is proportional to the softness, the share of points that are so near an edge."""
    rng = np.random.default_rng(5)
    with precision(np.float64):
        points = image_points(rng, 3000)[..., None]
        flesh, state = last(superquadrics_of(TREE, PARTS)), jnp.asarray(pose(rng))[:, None]
        distances = jax.jit(distances_of)(last(four_cameras()), flesh, last(TREE), state, points)
        hard = np.asarray(hard_coverage(distances))
        assert 0.05 < hard.mean() < 0.95
        softness = np.array([2.0, 1.0, 0.5, 0.25])
        soft = [1 - np.exp(np.asarray(soft_coverage(distances, jnp.full((4, 1), width)))) for width in softness]
        gaps = [np.abs(each - hard).mean() for each in soft]
    rate = np.polyfit(np.log(softness), np.log(gaps), 1)[0]
    assert 0.85 < rate < 1.15, gaps


@pytest.mark.full
def test_gradients_of_the_smooth_coverage_against_finite_differences():
    """Exact up to central differences: steps of 1e-6 leave some 1e-8 of the gradient; corners rarely move within one.

    A batch is one at a time, up to rounding.
    """
    rng = np.random.default_rng(6)
    with precision(np.float64):
        arguments = (four_cameras(), superquadrics_of(TREE, PARTS), TREE, image_points(rng, 40))
        score = batched_score(body_score, chunk=8)
        states = jnp.asarray(np.stack([pose(rng) for _ in range(2)]))
        steps = 1e-6 * jnp.eye(6)
        moved = jax.jit(jax.vmap(lambda x: score(x, *arguments)))
        found = np.asarray(jax.jit(jax.vmap(jax.grad(lambda x: score(x, *arguments))))(states))
        for state, gradient in zip(states, found, strict=True):
            expected = np.asarray(moved(state + steps) - moved(state - steps)) / 2e-6
            np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())
            assert np.all(np.abs(gradient) > 1e-4)
        alone = jax.jit(lambda x: score(x, *arguments))
        np.testing.assert_allclose(moved(states), [alone(state) for state in states], rtol=1e-9)


@pytest.mark.full
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
            nodes = nodes_of(last(TREE), changed, state, *angles)
            return sum(jnp.sum(w * leaf) for w, leaf in zip(weights, (nodes.points, 100 * nodes.normals), strict=True))

        start = [jnp.asarray(pose(rng))[:, None], *jax.tree.leaves(flesh)[2:]]
        found = jax.jit(jax.grad(score))(start)
        for number, leaf in enumerate(start):
            for place in np.ndindex(leaf.shape):
                step = 1e-6 * max(1.0, abs(float(leaf[place])))
                ends = [score([*start[:number], leaf.at[place].add(sign * step), *start[number + 1 :]]) for sign in (1, -1)]
                np.testing.assert_allclose(found[number][place], (ends[0] - ends[1]) / (2 * step), rtol=1e-5, atol=1e-4)


@pytest.mark.full
@pytest.mark.usefixtures("optimised")
def test_gradients_are_finite_seen_along_an_axis_and_from_behind():
    """The eye on the axis, inside a part, and the part behind the camera; in float32, where they fail first."""
    points = image_points(np.random.default_rng(8), 20)[:1]
    flesh = last(superquadrics_of(TREE, PARTS[:2], pieces=2))

    @jax.jit
    @jax.value_and_grad
    def score(state, view):
        distances = distances_of(view, flesh, last(TREE), state[:, None], points[..., None])
        return jnp.sum(soft_coverage(distances, jnp.full((1, 1), 2.0)))

    for distance, place in ((3000.0, 0.0), (100.0, 0.0), (3000.0, -6000.0)):
        value, gradient = score(jnp.array([0.0, place, 0.0, 0.0, 0.0, 0.0]), last(camera(distance, elevation=0.0)))
        assert np.isfinite(value) and np.all(np.isfinite(gradient)), (distance, place)


@pytest.mark.full
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
    with pytest.raises(ValueError, match="0 pieces"):
        superquadrics_of(TREE, PARTS, pieces=0)


@pytest.mark.full
@pytest.mark.parametrize("change", [{"rings": 1}, {"meridians": 7}, {"sides": 3}])
def test_what_is_too_coarse(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        outlines_of(last(camera(3000.0)), last(superquadrics_of(TREE, PARTS)), None, Fineness(**change))
