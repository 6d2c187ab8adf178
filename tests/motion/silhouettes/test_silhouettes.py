"""Silhouettes as Gaussian residuals: small at the truth, one density in all its forms, and a body that is followed by them."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
import pytest
from precision import precision

pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")
from silhouette_rooms import RECORDS, body, masks_of, pose

from poseppl.errors import InputError
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import VideoWarning
from poseppl.motion.likelihoods import SilhouetteSeen
from poseppl.motion.silhouettes.data import seek_silhouette
from poseppl.motion.silhouettes.scene import silhouette_scene
from poseppl.motion.tracking import TrackSettings, make_problem, track
from poseppl.runs.results import provenance
from poseppl.runs.run import frame_inputs


def scene_of(*states, **options):
    drawn = [masks_of(state) for state in states]
    masks = {name: np.stack([each[name] for each in drawn]) for name in drawn[0]}
    return silhouette_scene(body(), RECORDS, masks, **options)


def program_of(scene):
    """The compiled model, its observation and its inputs at the first frame."""
    problem = make_problem(scene)
    observation = jax.tree.map(lambda leaf: leaf[0], problem.observations)
    return problem.model, observation, frame_inputs(problem.inputs, 0)


def with_data(scene, **changes):
    return scene._replace(data=scene.data._replace(**changes))


def with_truth(scene, *states):
    known = np.stack(states)
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body().tree, x))(jnp.asarray(known, float)))
    return scene._replace(states=known, markers=markers)


@pytest.mark.full
def test_residuals_are_small_at_the_truth_and_large_elsewhere():
    truth = pose()
    model, _, inputs = program_of(with_truth(scene_of(truth), truth))
    moments = jax.jit(lambda x: model.observation_moments(x, inputs)[0])
    away = truth.copy()
    away[0] += 100.0
    # 100 mm are 4 px across; contours run along centres of pixels, half a pixel inside of the outline
    near, far = (np.asarray(moments(jnp.asarray(state, float))) for state in (truth, away))
    outline = slice(0, 64)
    assert np.sqrt(np.mean(near[outline] ** 2)) < 1.0
    assert np.sqrt(np.mean(far[outline] ** 2)) > 1.5


@pytest.mark.full
@pytest.mark.usefixtures("optimised")  # points with two nearest parts fall on either side as they are rounded
def test_one_pass_equals_normals_and_its_gradients_finite_differences():
    with precision(np.float64):
        truth = pose(1)
        model, observation, inputs = program_of(with_truth(scene_of(truth), truth))
        x = jnp.asarray(truth + 0.02 * np.random.default_rng(0).standard_normal(len(truth)), float)
        seen: BodyInputs = inputs

        def plain(x):
            mean, covariance = model.observation_moments(x, seen)
            density = dist.Normal(mean, jnp.sqrt(jnp.diagonal(covariance))).log_prob(0.0)
            return jnp.sum(jnp.where(observation.mask["silhouette"].ravel(), density, 0.0))

        density = jax.jit(lambda x: model.log_observation(x, observation, seen))
        np.testing.assert_allclose(density(x), jax.jit(plain)(x), rtol=1e-10)
        found = np.asarray(jax.jit(jax.grad(density))(x))
        step = 1e-6
        moved = np.array([(density(x.at[i].add(step)) - density(x.at[i].add(-step))) / (2 * step) for i in range(len(x))])
        # kinks: the nearest part of a point may change within a step, which few of the points do
        np.testing.assert_allclose(found, moved, rtol=1e-3, atol=1e-4 * np.abs(moved).max())
        np.testing.assert_allclose(found, np.asarray(jax.jit(jax.grad(plain))(x)), rtol=1e-8, atol=1e-9 * np.abs(found).max())


def with_edges(scene):
    """Edges where the masks' outlines are, and two lines across."""
    distance = np.abs(scene.data.distance).astype(np.float32)
    rows = np.arange(distance.shape[2], dtype=np.float32)[:, None]
    lines = np.minimum(np.abs(rows - 70), np.abs(rows - 100.5))
    return with_data(scene, edges=np.minimum(np.minimum(distance, lines), np.float32(10.0)))


@pytest.mark.full
def test_edges_have_gradients_and_pull_the_sides_of_parts():
    with precision(np.float64):
        truth = pose(1)
        model, observation, inputs = program_of(with_truth(with_edges(scene_of(truth)), truth))
        x = jnp.asarray(truth + 0.02 * np.random.default_rng(0).standard_normal(len(truth)), float)
        density = jax.jit(lambda x: model.log_observation(x, observation, inputs))
        found = np.asarray(jax.jit(jax.grad(density))(x))
        step = 1e-7
        moved = np.array([(density(x.at[i].add(step)) - density(x.at[i].add(-step))) / (2 * step) for i in range(len(x))])
        np.testing.assert_allclose(found, moved, rtol=1e-3, atol=1e-4 * np.abs(moved).max())  # kinks, as without edges
        both = jax.jit(lambda x: model.observation_moments(x, inputs)[0])(x).reshape(2, -1)
        without, _, plain = program_of(with_truth(scene_of(truth), truth))
        alone = jax.jit(lambda x: without.observation_moments(x, plain)[0])(x)
        np.testing.assert_allclose(both[:, : alone.size // 2].ravel(), alone, rtol=1e-12)
        beside = both[:, alone.size // 2 :]
        most = 4 * float(np.max(inputs.noise))  # bent by most tanh(. / most), no distance is more than that of the cut
        assert 0 <= beside.min() < 1.0 and 4.0 < beside.max() <= most * np.tanh(10.0 / most) + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("edges", [False, True])
def test_information_is_that_of_the_residuals(edges):
    truth = pose(2)
    scene = with_truth(scene_of(truth), truth)
    model, observation, inputs = program_of(with_edges(scene) if edges else scene)
    x = jnp.asarray(truth, float)
    both = jax.jit(lambda x: (model.observation_jacobian(x, inputs), model.observation_information(x, observation, inputs)))(x)
    jacobian, found = map(np.asarray, both)
    pull = jax.jit(lambda x, rows: jax.vjp(lambda x: model.observation_moments(x, inputs)[0], x)[1](rows)[0])
    for rows in np.random.default_rng(0).standard_normal((4, len(jacobian))).astype(jacobian.dtype):
        wanted = np.asarray(pull(x, jnp.asarray(rows)))
        np.testing.assert_allclose(
            rows @ jacobian, wanted, rtol=1e-3, atol=1e-5 * np.abs(jacobian).max() * len(jacobian) ** 0.5
        )  # float32
    weight = np.asarray(observation.mask["silhouette"]).ravel() / np.repeat(np.asarray(inputs.noise), len(jacobian) // 2) ** 2
    expected = jacobian.T @ (jacobian * weight[:, None])
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4 * np.abs(expected).max())  # float32


@pytest.mark.full
def test_a_batch_of_particles_is_each_of_them():
    truth = pose(3)
    model, observation, inputs = program_of(with_truth(scene_of(truth), truth))
    x = jnp.asarray(truth + 0.05 * np.random.default_rng(1).standard_normal((70, len(truth))), float)
    density = jax.jit(lambda x: model.log_observation(x, observation, inputs))
    together = jax.jit(jax.vmap(density))(x)  # 70 is more than a chunk
    np.testing.assert_allclose(together, [density(each) for each in x], rtol=2e-5)


@pytest.mark.full
def test_a_camera_with_an_empty_mask_does_not_count():
    truth = pose()
    masks = {name: np.stack([mask]) for name, mask in masks_of(truth).items()}
    masks["right"][:] = 0
    with pytest.warns(VideoWarning, match="right.*frame 0.*does not count"):
        scene = with_truth(silhouette_scene(body(), RECORDS, masks), truth)
    assert scene.data.usable.tolist() == [[True, False]]
    model, observation, inputs = program_of(scene)
    assert np.asarray(observation.mask["silhouette"]).any(1).tolist() == [True, False]
    elsewhere = inputs._replace(
        seen=SilhouetteSeen(inputs.seen.contour.at[1].add(50.0), inputs.seen.distance.at[1].add(9.0), inputs.seen.scale)
    )
    x = jnp.asarray(truth, float)
    assert model.log_observation(x, observation, inputs) == model.log_observation(x, observation, elsewhere)


@pytest.mark.full
def test_pictures_of_any_size_say_the_same():
    """A large picture of the same scene has the same residuals, in units of the noise, near and far from the truth."""
    truth = pose(1)
    far = truth + np.r_[500.0, np.zeros(27)]
    found = []
    for times in (1, 4):
        masks = {name: np.kron(mask, np.ones((times, times), np.uint8))[None] for name, mask in masks_of(truth).items()}
        scene = with_truth(silhouette_scene(body(), [larger(record, times) for record in RECORDS], masks), truth)
        model, _, inputs = program_of(scene)
        moments = jax.jit(lambda x, model=model, inputs=inputs: model.observation_moments(x, inputs)[0])
        found.append([np.asarray(moments(jnp.asarray(x, float))).reshape(2, -1) / inputs.noise[:, None] for x in (truth, far)])
    (near, away), (near_large, away_large) = np.abs(np.asarray(found)).mean((2, 3))
    np.testing.assert_allclose(near_large, near, atol=0.1)  # a quarter of a pixel of the small picture is a tenth of the noise
    np.testing.assert_allclose(away_large, away, rtol=0.05)
    assert away > 2 * near
    for large in (found[0][1], found[1][1]):
        assert 3.5 < np.abs(large).max() < 4.0  # bounded alike


def larger(record, times):
    """A camera whose pictures have so many times the rows and columns; centres of pixels are at whole numbers in both."""
    matrix = record.matrix * np.array([[times], [times], [1.0]])
    matrix[:2, 2] += (times - 1) / 2
    return record._replace(matrix=matrix, size=tuple(times * side for side in record.size))


@pytest.mark.full
def test_hidden_pixels_are_no_evidence():
    truth = pose()
    masks = {name: mask[None].copy() for name, mask in masks_of(truth).items()}
    table = np.zeros(masks["left"].shape[1:], np.uint8)
    rows = np.flatnonzero(masks["left"][0].any(1))
    table[int(rows.mean()) :] = 1  # hides all below the middle
    masks["left"][0][table != 0] = 0
    scene = with_truth(silhouette_scene(body(), RECORDS, masks, occlusion={"left": table}), truth)
    wardrobe = silhouette_scene(body(), RECORDS, masks, occlusion={"left": np.where(table, 1, 2)})  # the person is before it
    np.testing.assert_array_equal(wardrobe.data.on_outline, scene.data.on_outline)
    contour, counts = scene.data.contour[0, 0], scene.data.on_outline[0, 0]
    assert counts.any() and not counts.all()
    assert (contour[counts, 1] < int(rows.mean()) - 2).all()
    blind = with_truth(silhouette_scene(body(), RECORDS, masks), truth)
    knowing, unknowing = (beyond(each, truth) for each in (scene, blind))
    # residuals are bounded by 4 * 2.55 px of noise = 10.2
    # with the table known, the legs behind it are no further out than parts in view are; without, they stick out by far
    assert knowing.max() < 3.0 and unknowing.max() > 7.0


def beyond(scene, state):
    """How far each part sticks out of the left camera's silhouette, px."""
    model, _, inputs = program_of(scene)
    distances = np.asarray(model.observation_moments(jnp.asarray(state, float), inputs)[0]).reshape(2, -1)
    return distances[0, scene.data.contour.shape[2] :]


@pytest.mark.full
def test_the_start_is_found_without_a_truth():
    truth = pose(4)
    start = seek_silhouette(scene_of(truth), body().params)
    found, known = (np.asarray(marker_positions(body().tree, jnp.asarray(x, float))) for x in (start, truth))
    # two cameras do not tell a limb from its mirror image: the trunk is what must be found
    trunk = [body().tree.marker_names.index(name) for name in ("pelvis", "chest", "neck")]
    assert np.linalg.norm((found - known)[trunk], axis=-1).max() < 120.0


@pytest.mark.full
def test_the_start_faces_the_camera_that_was_given():
    scene = scene_of(pose(4))
    tree = body().tree
    for name, number in (("left", 0), ("right", 1)):
        start = seek_silhouette(with_data(scene, facing=name), body().params)
        heading = start[tree.coordinates.index((tree.joint_names[0], "Z"))]
        towards = np.asarray(scene.cameras.centre)[number, :2] - start[:2]
        assert np.array([-np.sin(heading), np.cos(heading)]) @ towards > 0
    with pytest.raises(InputError, match="no camera 'middle'.*left, right"):
        seek_silhouette(with_data(scene, facing="middle"), body().params)


@pytest.mark.full
def test_cameras_must_match():
    masks = {name: mask[None] for name, mask in masks_of(pose()).items()}
    with pytest.raises(InputError, match="left, right.*left, middle"):
        silhouette_scene(body(), RECORDS, {"left": masks["left"], "middle": masks["right"]})
    with pytest.raises(InputError, match="camera left: the pictures have 240 x 150 pixels, the calibration 240 x 180"):
        silhouette_scene(body(), RECORDS, {**masks, "left": masks["left"][:, :-30]})
    with pytest.warns(VideoWarning, match="camera left.*240 x 179.*cut off"):
        scene = silhouette_scene(body(), RECORDS, {**masks, "left": masks["left"][:, :-1]})
    assert scene.data.usable.all()


@pytest.mark.slow
def test_a_moving_body_is_followed():
    states = [pose() + t * np.r_[20.0, 0.0, 0.0, 0.02 * np.ones(25)] for t in range(6)]
    scene = with_truth(scene_of(*states), *states)
    tree = track(scene, TrackSettings()).result
    assert "predictive" not in tree.children
    assert "Silhouettes of site 'silhouette' are a heuristic" in provenance(tree)["predictive checks"]
    error = np.linalg.norm(tree["summary"].dataset["markers_mean"].values - scene.markers, axis=-1)
    assert error.mean() < 40.0
