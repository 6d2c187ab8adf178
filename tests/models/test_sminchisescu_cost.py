"""The image cost: derivatives, what nodes without assignments cost, and where it is least on rendered frames."""

from __future__ import annotations

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from poseppl_models.sminchisescu_triggs.body import superquadric_body
from poseppl_models.sminchisescu_triggs.cost import ENTRIES, NODES, CostSettings, curvature_roots, residuals_of
from poseppl_models.sminchisescu_triggs.likelihood import ContourAndFlow
from poseppl_models.sminchisescu_triggs.programs import at_levels, cost_noise, image_programs, seen_in_images
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, part_axes, superquadrics_of
from precision import precision
from scipy.ndimage import gaussian_filter

from poseppl.errors import PosepplError
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import Joint, Marker, kinematic_tree, look_at, marker_positions
from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.rendering import Stage, build_setting
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.program import Leclerc, Lorentzian

pytestmark = pytest.mark.full

SETTINGS = CostSettings()
SIZE = (240, 180)


def last(tree):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], tree)


@cache
def arm_scene(dtype):
    """The arm in front of smooth noise, with a frame before in which it was elsewhere, and flow."""
    body, rng = superquadric_body("arm"), np.random.default_rng(0)
    camera = look_at((500.0, -1500.0, 1300.0), (0.1, 0.0, 1200.0), 400.0)._replace(principal=jnp.array([[119.5, 89.5]]))
    pose = np.array(body.rest)
    pose[3:] = [0.2, -0.3, 0.6, 1.2, 0.3]
    image = gaussian_filter(rng.normal(0, 1, SIZE[::-1]), 2.0)
    picture = np.uint8(128 + 300 * image)
    seen = seen_in_images([picture], pose + 0.02 * rng.normal(size=8))
    shape = seen.energy.shape
    flow = jnp.asarray(gaussian_filter(rng.normal(0, 20, (1, 2, *shape[1:])), (0, 0, 6, 6)), float)
    seen = seen._replace(
        flow=flow,
        trust=jnp.full((1, 3, *shape[1:]), 0.8) * jnp.array([1.0, 0.3, 0.7])[:, None, None],
        boundary=jnp.asarray(np.abs(image)[None] * 3 % 1, float),
    )
    return body, camera, jnp.asarray(pose, float), seen


def distribution(pose, scene, seen=None):
    body, camera, _, own = scene
    return ContourAndFlow(body.tree, body.flesh, camera, pose, own if seen is None else seen, cost_noise(), SETTINGS)


def test_gradient_with_its_edges_held_fixed():
    """Central differences in float64 of the cost whose edges are those of the middle; occluders held fixed too are noticed."""
    with precision(np.float64):
        scene = body, camera, pose, seen = arm_scene(np.float64)
        fixed = (*last((body.tree, body.flesh, camera)), last(seen), last(cost_noise()))
        steps = 1e-5 * np.where(np.arange(8) < 3, 10.0, 1.0)[:, None] * np.eye(8)

        def placed(state):
            return part_axes(fixed[1], frames_of(fixed[0], state))

        @jax.jit
        def costs(states, hiding):
            """Cost of states (d, N), with edges assigned at the pose, and with occluders at states (d, N)."""
            middle = jax.tree.map(
                lambda leaf: jnp.broadcast_to(leaf, (*leaf.shape[:-1], states.shape[1])), placed(pose[:, None])
            )
            found = residuals_of(SETTINGS, fixed, placed(states), placed(hiding), middle)
            return 0.5 * jnp.sum(found**2, (0, 1, 2))

        @jax.jit
        def slope(state):
            zeros = jnp.zeros((1, len(body.flesh.names) * ENTRIES))
            return jax.grad(lambda x: -distribution(x, scene).summed_log_prob(zeros, None))(state)

        states = (pose + jnp.concatenate([jnp.asarray(steps), -jnp.asarray(steps)])).T
        still = jnp.broadcast_to(pose[:, None], states.shape)
        size = 2 * steps.max(1)
        differences, without = (
            np.asarray(each[:8] - each[8:]) / size for each in (costs(states, states), costs(states, still))
        )
        np.testing.assert_allclose(slope(pose), differences, rtol=1e-5, atol=1e-7 * np.abs(differences).max())
        assert np.abs(without - differences).max() > 1e-3 * np.abs(differences).max()


@pytest.mark.slow  # half a minute to compile
def test_jacobian_with_what_is_hidden_held_fixed():
    """Exact: by six derivatives for each part, and by automatic differentiation through the tree."""
    with precision(np.float64):
        scene = body, camera, pose, seen = arm_scene(np.float64)
        fixed = (*last((body.tree, body.flesh, camera)), last(seen), last(cost_noise()))
        others = part_axes(fixed[1], frames_of(fixed[0], pose[:, None]))

        def residuals(state):
            own = part_axes(fixed[1], frames_of(fixed[0], state[:, None]))
            return residuals_of(SETTINGS, fixed, own, others).ravel()

        expected = jax.jit(jax.jacfwd(residuals))(pose)
        mask = jnp.arange(len(expected)).reshape(1, -1) % 2 == 0
        found, masked = jax.jit(lambda x: [distribution(x, scene).whitened_jacobian(each) for each in (None, mask)])(pose)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
        np.testing.assert_array_equal(masked, jnp.where(mask.ravel()[:, None], found, 0.0))


def test_density_is_that_of_the_residuals():
    scene = arm_scene(np.float32)
    mask = jnp.arange(len(scene[0].flesh.names) * ENTRIES)[None] % 3 > 0
    zeros = jnp.zeros(mask.shape)

    @jax.jit
    def both(pose):
        made = distribution(pose, scene)
        return made.summed_log_prob(zeros, mask), jnp.sum(jnp.where(mask, made.log_prob(zeros), 0.0))

    summed, expected = both(scene[2])
    np.testing.assert_allclose(summed, expected, rtol=1e-5)


def test_a_blank_image_costs_what_has_no_assignment():
    """14 nodes of a limb on the contour cost nu / 2, and 9 that face away nu; behind a wide part they cost k nu."""
    body, camera, pose, seen = arm_scene(np.float32)
    blank = seen._replace(energy=0 * seen.energy, trust=0 * seen.trust)
    noise = cost_noise()
    per_node = float(noise.weight[0]) * SETTINGS.strength / NODES
    tree = kinematic_tree([Joint("root", None, (0, 0, 0), "ZYX")], [Marker("root", "root")])
    limb = Superquadric("limb", "root", (40.0, 40.0, 150.0), (0.6, 1.0), across=(1.0, 0.3, 0.0))
    wall = Superquadric("wall", "root", (500.0, 150.0, 500.0), centre=(0.0, -500.0, 0.0))
    lens = look_at((0.0, -3000.0, 0.0), (0.0, 0.0, 0.0), 400.0)

    @partial(jax.jit, static_argnums=0)
    def costs(count):
        flesh = superquadrics_of(tree, [limb, wall][:count], pieces=1)
        fixed = (*last((tree, flesh, lens)), last(blank._replace(previous=jnp.zeros(6))), last(noise))
        found = residuals_of(SETTINGS, fixed, part_axes(fixed[1], frames_of(fixed[0], jnp.zeros((6, 1)))))
        return 0.5 * jnp.sum(found**2, (2, 3))[0]

    alone, behind = float(costs(1)[0]), float(costs(2)[0])
    np.testing.assert_allclose(alone, per_node * (14 * 0.5 + 9), rtol=0.03)
    np.testing.assert_allclose(behind, per_node * (SETTINGS.occluded * (14 + 9) + 9), rtol=0.03)


def rendered(poses, body):
    """Pictures of poses (T, d) in an empty room, and their camera; skips without OpenGL."""
    markers = np.stack([np.asarray(marker_positions(body.tree, jnp.asarray(pose, float))) for pose in poses])
    setting = build_setting(body.tree.marker_names, markers, clutter=False, cameras=1, size=(320, 240), focal=400.0)
    try:
        with Stage(setting) as stage:
            pictures = []
            for frame in range(len(poses)):
                stage.pose(frame)
                pictures.append(stage.picture(0).copy())
    except PosepplError as error:
        if "libegl1" in str(error):
            pytest.skip(f"no OpenGL here: {error}")
        raise
    return pictures, cameras_of_records(setting.cameras)


@pytest.mark.slow
def test_the_truth_costs_least_on_a_rendered_frame():
    """None of 24 poses 0.2 rad and 40 mm off costs less than the truth, nor by edges alone, where being hidden costs little.

    With the paper's k > 1 some do without flow: an arm that is truly hidden costs more than one in the open without an edge.
    And of the picture of one of these poses that pose costs least, and not the first.
    """
    body, rng = superquadric_body("full"), np.random.default_rng(1)
    bent = {("shoulder_r", "X"): 0.9, ("elbow_r", "X"): 1.0, ("hip_l", "X"): 0.5, ("pelvis", "Z"): 0.5}
    pose = body.rest + np.array([bent.get(coordinate, 0.0) for coordinate in body.tree.coordinates])
    before = pose - 0.03 * rng.normal(size=34) * (np.arange(34) >= 6)
    others = pose + np.where(np.arange(34) < 3, 40.0, 0.2) * rng.normal(size=(24, 34))
    pictures, cameras = rendered([before, pose, others[0]], body)
    poses = jnp.asarray(np.concatenate([pose[None], others]), float)

    @partial(jax.jit, static_argnums=1)
    def costs(seen, settings=SETTINGS):
        made = jax.vmap(lambda pose: ContourAndFlow(body.tree, body.flesh, cameras, pose, seen, cost_noise(), settings).loc)
        return 0.5 * jnp.sum(made(poses) ** 2, (1, 2))

    found = costs(seen_in_images([pictures[1]], before, [pictures[0]]))
    assert found[0] < found[1:].min(), found
    lenient = CostSettings(occluded=0.5)
    by_edges, anothers = (costs(seen_in_images([picture], before), lenient) for picture in pictures[1:])
    assert by_edges[0] < by_edges[1:].min(), by_edges
    assert np.argmin(anothers) == 1 and anothers[0] > anothers[1] + 5, anothers


def arm_model(parts=True):
    body, camera, pose, seen = arm_scene(np.float32)
    walk = pose, jnp.full(8, 0.1), jnp.full(8, 0.1)
    inputs = BodyInputs(camera, cost_noise(), *walk, body.tree, seen=seen, flesh=body.flesh)
    program = image_programs("arm", parts=parts)
    model = program.compile(inputs, {})
    return model, model.observe({name: np.zeros(site.shape) for name, site in model.observation_sites.items()}), inputs


def test_programs_have_all_priors():
    """The arm bent into its limit, or its hand into its upper arm: the one is impossible, the other costs."""
    model, observation, inputs = arm_model()
    assert set(observation.values) == {"image", "parts"}
    names, density = (
        list(superquadric_body("arm").tree.coordinates),
        jax.jit(lambda x: model.log_observation(x, observation, inputs)),
    )
    bent = inputs.start.at[names.index(("elbow_r", "X"))].set(2.61)
    beyond = inputs.start.at[names.index(("elbow_r", "X"))].set(2.7)
    assert model.log_initial(beyond, inputs) == -np.inf < model.log_initial(bent, inputs)
    assert np.isfinite(density(inputs.start)) and np.isfinite(density(bent))


@pytest.mark.slow  # half a minute to compile
def test_curvature_is_that_of_image_and_parts():
    model, observation, inputs = arm_model()
    information = np.asarray(jax.jit(lambda x: model.observation_information(x, observation, inputs))(inputs.start))
    scene = arm_scene(np.float32)
    rows, others = jax.jit(lambda x: [(made := distribution(x, scene)).curvature_rows(None), made.whitened_jacobian(None)])(
        inputs.start
    )
    image = np.asarray(rows.T @ rows)
    assert np.linalg.eigvalsh(information - image).min() > -1e-3 * np.abs(information).max()
    np.testing.assert_allclose(information[:3, :3], image[:3, :3], rtol=1e-3, atol=1e-6)  # a shift moves no part into another
    assert np.trace(image[:3, :3]) < 0.9 * np.trace((others.T @ others)[:3, :3])  # which Gauss-Newton's alone would be


@pytest.mark.parametrize("potential", [Leclerc, Lorentzian])
def test_roots_are_those_of_second_differences(potential):
    """Curvature of 1/2 rho(r^2) in two dimensions, along an error and across it; Leclerc's is 0 at s = nu / 2."""
    with precision(np.float64):
        step, strength = 1e-4, 4.0
        bends = []
        for error in (0.3, 1.0, 2.0**0.5, 2.5):
            around = error * np.array([1.0, 0.0]) + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1], [0, 0]])
            costs = 0.5 * potential(dist.Normal(0.0, 1.0), strength).potential(jnp.sum(jnp.asarray(around) ** 2, 1))
            bends.append([(costs[i] + costs[i + 1] - 2 * costs[4]) / step**2 for i in (2, 0)])
        squared = jnp.array([0.09, 1.0, 2.0, 6.25])
        across, along = curvature_roots(potential, squared, strength)
        np.testing.assert_allclose(np.stack([across**2, along**2], 1), np.maximum(bends, 0.0), atol=1e-6)
        assert (potential is Leclerc) == bool(along[2] < 1e-3)


LIMB_TREE = kinematic_tree([Joint("root", None, (0, 0, 0), "ZYX")], [Marker("root", "root")])


def limb_costs(seen, noise, states):
    """Costs (S,) of a limb of 80 by 300 mm alone, 0.4 px a mm, in states (S, 6)."""
    limb = Superquadric("limb", "root", (40.0, 40.0, 150.0), (0.6, 1.0), across=(1.0, 0.3, 0.0))
    lens = look_at((0.0, -3000.0, 0.0), (0.0, 0.0, 0.0), 1200.0)._replace(principal=jnp.array([[119.5, 89.5]]))
    levels = len(noise.edges)
    lens = at_levels(lens, (1.0,) * levels)

    @jax.jit
    def costs(states):
        flesh = superquadrics_of(LIMB_TREE, [limb], pieces=1)
        fixed = (*last((LIMB_TREE, flesh, lens)), last(seen), last(noise))
        found = residuals_of(SETTINGS, fixed, part_axes(fixed[1], frames_of(fixed[0], states.T)))
        return 0.5 * jnp.sum(found**2, (0, 1, 2))

    return np.asarray(costs(jnp.asarray(states, float)))


def bar(across=0.0):
    """A picture of such a limb, upright, so many px to the right of the middle."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    inside = (np.abs(x - 119.5 - across) < 16) & (np.abs(y - 89.5) < 60)
    return np.uint8(np.where(inside, 200, 90))


def test_a_limb_that_points_to_the_eye_gains_nothing():
    """Without an edge anywhere both cost as much, to 3 %; rings seen as a whole would be 14 nodes of 32 for nothing."""
    blank = seen_in_images([np.full(SIZE[::-1], 128, np.uint8)], np.zeros(6))
    noise = cost_noise()
    across, end_on = limb_costs(blank, noise, [[0.0] * 6, [0.0] * 5 + [np.pi / 2]])
    assert abs(end_on / across - 1) < 0.03
    assert 0.5 * 14 * float(noise.weight[0]) * SETTINGS.strength / NODES > 0.3 * across


def test_a_coarse_level_pulls_from_afar():
    """A limb 20 px off its edges, in steps of 4 px towards them: with one level its cost hardly changes, with two it falls."""
    states = np.zeros((4, 6))
    states[:, 0] = np.array([20.0, 16.0, 12.0, 0.0]) / 0.4
    falls = {}
    for levels in ((1.0,), (1.0, 4.0)):
        seen, noise = seen_in_images([bar()], np.zeros(6), levels=levels), cost_noise(levels=levels)
        costs = limb_costs(seen, noise, states)
        assert costs[3] < costs[:3].min()
        falls[len(levels)] = -np.diff(costs)[:2]
    assert np.abs(falls[1]).sum() < 0.4 < 1.0 < falls[2].sum() and falls[2].min() > 0, falls


def test_flow_pulls_as_far_as_it_is_believed():
    """Believed to the right alone, a limb that is 12 px to the right costs more, and one 12 px up the same."""
    blank = seen_in_images([np.full(SIZE[::-1], 128, np.uint8)], np.zeros(6))
    states = np.zeros((3, 6))
    states[1, 0] = states[2, 2] = 12.0 / 0.4
    for believed, (right, up) in {(1.0, 0.0, 0.0): (True, False), (0.0, 0.0, 1.0): (False, True)}.items():
        trust = jnp.ones_like(blank.trust) * jnp.array(believed)[:, None, None]
        still, *moved = limb_costs(blank._replace(trust=trust), cost_noise(), states)
        assert [cost > still + 2 for cost in moved] == [right, up]
        assert all(abs(cost - still) < 0.2 for cost, pulled in zip(moved, (right, up), strict=True) if not pulled)
