"""Errors of a detector that last: what intervals that know of them hold, and that those of independent errors do not."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr
from limbs_backwards import backwards
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_models.bodies.detected_points import FREEDOM

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import Cameras, join_cameras, look_at, project
from poseppl.motion.geometry.cameras import moved_cameras
from poseppl.motion.keypoints.camera_refinement import PRIOR_ANGLE, PRIOR_POSITION, bundle_adjust
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, track
from poseppl.motion.tracking.body_sizes import MeasuredLengths, lengths_per_place, measured_lengths
from poseppl.motion.tracking.lasting_errors import (
    ERROR_SHARE,
    ERRORS_LAST,
    REST_SPREAD,
    ROUNDED,
    SHIFT,
    SHIFTS_LAST,
    mean_deviation,
    with_ar1_noise,
    with_no_errors,
)
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import make_problem
from poseppl.motion.tracking.recorded_model import offsets_per_length
from poseppl.motion.tracking.scene import Scene
from poseppl.motion.tracking.velocity_learning import velocity_walk
from poseppl.motion.tracking.walk import velocity_steps
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.run import frame_inputs
from poseppl.smoothers.base import History

RATE, FRAMES, NOISE = 30.0, 40, 0.004


def stationary(rng: np.random.Generator, shape: tuple[int, ...], lasts: float) -> Floats:
    """An autoregressive sequence of variance 1."""
    kept = np.exp(-1 / RATE / lasts)
    values = [rng.standard_normal(shape)]
    for _ in range(1, FRAMES):
        values.append(kept * values[-1] + np.sqrt(1 - kept**2) * rng.standard_normal(shape))
    return np.stack(values)


def cameras_about(subject: MovingSubject, *focal: float) -> Cameras:
    middle = subject.markers.reshape(-1, 3).mean(0)
    centres = middle + np.array([[4000.0, 0, 400], [0, 4000, 800], [-3000, -3000, 200]])
    return join_cameras([look_at(tuple(centre), tuple(middle), *focal) for centre in centres])


def detected(rng: np.random.Generator, subject: MovingSubject, cameras: Cameras, noise: float) -> tuple[Floats, Floats]:
    """Places of the points that a detector means, and where it sees them."""
    places = subject.markers + SHIFT * stationary(rng, subject.markers.shape[1:], SHIFTS_LAST)
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(places, float)), np.float64), 0, 1)
    lasting = stationary(rng, clean.shape[1:], ERRORS_LAST)
    other = rng.standard_normal(clean.shape) / np.sqrt(rng.chisquare(FREEDOM, clean.shape[:-1]) / FREEDOM)[..., None]
    return places, clean + noise * (np.sqrt(ERROR_SHARE) * lasting + np.sqrt(1 - ERROR_SHARE) * other)


@pytest.fixture(scope="module")
def scene() -> Scene[PointData]:
    """A walk in three cameras, with a detector's errors."""
    subject = walking_subject(frames=f"0:{FRAMES}", rate=RATE)
    cameras = cameras_about(subject)
    places, points = detected(np.random.default_rng(1), subject, cameras, NOISE)
    data = PointData(points, np.full(points.shape[1:3], NOISE))
    return Scene(subject.body, cameras, ("a", "b", "c"), data, np.arange(FRAMES), RATE, "", subject.states, places)


@pytest.fixture(scope="module")
def filtered(scene: Scene[PointData]) -> xr.DataTree:
    return track(scene, TrackSettings(filter="kalman")).result


def shares_held(tree: xr.DataTree, scene: Scene[PointData]) -> Floats:
    """Coverage of 90 % intervals over frames, for each coordinate of a marker."""
    draws: Any = tree["posterior/markers"].values
    low, high = np.quantile(draws.reshape(-1, *draws.shape[2:]), [0.05, 0.95], axis=0)
    return np.asarray(((scene.markers >= low) & (scene.markers <= high)).mean(0).ravel())


def excess(tree: xr.DataTree, scene: Scene[PointData]) -> tuple[float, float]:
    """Coverage of true places by 90 % intervals, and how many standard errors it is above 0.9; coordinates of markers count."""
    held = shares_held(tree, scene)
    return float(held.mean()), float((held.mean() - 0.9) / (held.std() / np.sqrt(held.size)))


@pytest.mark.slow
def test_intervals_hold_when_errors_are_known_to_last(scene: Scene[PointData], filtered: xr.DataTree) -> None:
    lasting, error = excess(smooth(filtered, SmoothSettings("laplace", errors="lasting")), scene)
    independent, other = excess(smooth(filtered, SmoothSettings("laplace")), scene)
    assert abs(error) < 4, lasting
    assert other < -4, independent


def test_a_start_that_was_sought_in_the_points_is_no_prior_of_itself(scene: Scene[PointData]) -> None:
    """A known start stays; else angles are those of people at rest, and the root may be far from where it was found."""
    known, sought = (make_problem(each) for each in (scene, scene._replace(states=None)))
    kept, opened = (with_ar1_noise(each, scene.frames, RATE).inputs for each in (known, sought))
    for name in ("start", "start_scale"):
        assert np.array_equal(getattr(kept, name).value, getattr(known.inputs, name).value)
    root = np.arange(scene.body.tree.dimension) < 6
    assert np.allclose(opened.start.value, np.where(root, sought.inputs.start.value, scene.body.rest))
    assert np.allclose(np.asarray(opened.start_scale.value)[~root], REST_SPREAD)
    assert np.all(np.asarray(opened.start_scale.value)[root] > 5 * np.asarray(sought.inputs.start_scale.value)[root])


@pytest.mark.full
@pytest.mark.parametrize("mean_reverting", [False, True], ids=["random walk", "mean-reverting"])
def test_the_body_walks_as_its_velocities_were_learned(scene: Scene[PointData], mean_reverting: bool) -> None:
    """Moments of poses and velocities in the program are those of the transitions that their scales are learned with."""
    plain = make_problem(scene, mean_reverting=mean_reverting)
    problem, seconds = with_ar1_noise(plain, scene.frames, RATE), np.full(FRAMES, 1 / RATE)
    model, own, d = problem.model, problem.inputs, scene.body.tree.dimension
    units = tuple(jnp.asarray(each, float) for each in velocity_steps(seconds))
    stacked = frame_sequence(plain.observations, plain.inputs, None).stacked_inputs()
    walk = velocity_walk(plain.model, own.velocities.scale.value, units, tuple(range(d)), stacked)
    shift, error = (int(np.prod(shape)) for shape in (scene.markers.shape[1:], scene.data.points.shape[1:]))
    part = np.r_[:d, d + shift + error : 2 * d + shift + error]
    inputs = frame_inputs(own, 1)
    x = jnp.asarray(np.random.default_rng(0).normal(size=model.dimension), float)
    mean, covariance = (np.asarray(each) for each in jax.jit(model.transition_moments)(x, inputs))
    np.testing.assert_allclose(walk.means[1] + walk.jacobians[1] @ x[part], mean[part], rtol=1e-4, atol=1e-4)
    scales = np.sqrt(np.diag(covariance)[part])
    product = np.asarray(walk.precisions[1]) @ covariance[np.ix_(part, part)]
    np.testing.assert_allclose(product * scales / scales[:, None], np.eye(2 * d), atol=1e-3)


@pytest.mark.slow
def test_the_result_is_that_of_the_body(scene: Scene[PointData], filtered: xr.DataTree) -> None:
    tree = smooth(filtered, SmoothSettings("laplace", {"num_draws": "60"}, errors="lasting"))
    assert tree["unconstrained_posterior"].dataset["state"].sizes["state_dim"] == scene.body.tree.dimension
    assert tree["posterior"].sizes["draw"] == 60
    drawn: dict[str, Any] = {name: np.asarray(tree[f"posterior/{name}"].to_numpy())[0, 0] for name in ("markers", "points")}
    images = jax.vmap(lambda markers: project(scene.cameras, markers))(jnp.asarray(drawn["markers"]))
    assert np.allclose(images, drawn["points"], atol=1e-4)
    error, before = (np.linalg.norm(of["summary/markers_mean"].to_numpy() - scene.markers, axis=-1) for of in (tree, filtered))
    assert np.median(error) < np.median(before)


@pytest.mark.full
def test_the_same_recording_is_posed_for_programs_that_are_compiled(scene: Scene[PointData]) -> None:
    """Model and collector are the very objects of the time before, for which JAX has compiled."""
    once, again = (with_ar1_noise(make_problem(scene), scene.frames, scene.rate) for _ in range(2))
    assert once.model is again.model and once.collector(20) is again.collector(20)
    assert once.collector(20) is not again.collector(21)


@pytest.mark.full
def test_a_smoother_starts_from_limbs_that_are_bent_forwards(scene: Scene[PointData]) -> None:
    problem = with_ar1_noise(make_problem(scene), scene.frames, scene.rate)
    assert scene.states is not None
    states = np.asarray(scene.states, np.float64)
    arms = np.tile([True, False, False, True], (FRAMES, 1))
    weights = jnp.zeros((FRAMES, 1))
    history = History(backwards(scene.body, states, arms)[:, None], weights, weights.astype(int), weights[:, 0] > 0)
    found = with_no_errors(history, problem).particles[:, 0]
    np.testing.assert_allclose(found[:, : states.shape[1]], states, atol=2e-3)
    assert found.shape[1] == problem.model.dimension and not np.any(found[:, states.shape[1] :])


@pytest.mark.full
def test_what_cannot_have_lasting_errors_is_refused(scene: Scene[PointData], filtered: xr.DataTree) -> None:
    problem = with_ar1_noise(make_problem(scene), scene.frames, scene.rate)
    with pytest.raises(InputError, match="whole body"):
        with_ar1_noise(problem, scene.frames, scene.rate)
    with pytest.raises(InputError, match="errors: "):
        smooth(filtered, SmoothSettings(errors="correlated"))  # type: ignore[arg-type]
    cameras = jax.tree.map(lambda leaf: leaf[:1], scene.cameras)
    data = scene.data._replace(points=scene.data.points[:, :1], noise=np.asarray(scene.data.noise)[:1])
    alone = scene._replace(cameras=cameras, camera_names=scene.camera_names[:1], data=data)
    with pytest.raises(InputError, match="from a person's distance"):
        smooth(track(alone, TrackSettings(filter="kalman")), SmoothSettings("laplace", errors="lasting"))


@pytest.mark.full
def test_markers_are_those_of_a_body_with_other_lengths(scene: Scene[PointData], filtered: xr.DataTree) -> None:
    lengths = dict(scene.body.lengths)
    measured = MeasuredLengths(offsets_per_length(filtered), lengths_per_place(scene.body, scene.markers))
    problem = with_ar1_noise(make_problem(scene), scene.frames, scene.rate, lengths=measured)
    assert problem.num_static == len(lengths) and problem.markers is not None
    assert scene.states is not None
    errors = np.random.default_rng(0).normal(size=len(lengths)) * SHIFT
    longer = full_body({name: value + error for (name, value), error in zip(lengths.items(), errors, strict=True)})
    state = np.zeros(problem.model.dimension)
    state[: scene.body.tree.dimension], state[-len(lengths) :] = scene.states[7], errors
    found = problem.markers(jnp.asarray(state, float), frame_inputs(problem.inputs, 7))
    np.testing.assert_allclose(found, longer.places(scene.states[7:8])[0], atol=0.02)


@pytest.mark.full
def test_lengths_are_off_as_the_places_are_that_they_were_measured_in(scene: Scene[PointData], filtered: xr.DataTree) -> None:
    """Shifts d of places change lengths l by less than d^2 / l beside what is linear; variances are those of differences."""
    places, body = np.asarray(scene.markers)[:1], scene.body
    per_place = lengths_per_place(body, places)
    shifts = 0.5 * np.random.default_rng(0).standard_normal((50, *places.shape))
    before, *after = (
        np.array(list(measured_lengths(body, places + shift).values())) for shift in (np.zeros_like(places), *shifts)
    )
    names = list(measured_lengths(body, places))
    order = [list(body.lengths).index(name) for name in names]
    found, told = np.stack(after) - before, shifts.reshape(50, -1) @ per_place[order].T
    assert np.abs(found - told).max() < (6 * 0.5) ** 2 / 90 < 0.2 * found.std(), np.abs(found - told).max()
    lengths = MeasuredLengths(offsets_per_length(filtered), per_place)
    root = with_ar1_noise(make_problem(scene), scene.frames, scene.rate, lengths=lengths).inputs.errors.length_root.value
    deviation, seconds = np.sqrt(np.square(root).sum(1) - ROUNDED**2), np.full(FRAMES, 1 / RATE)
    of = dict(zip(body.lengths, deviation / mean_deviation(seconds), strict=True))
    for name, known in (("spine", np.sqrt(2)), ("thigh", 1.0), ("shank", 1.0), ("hip_width", np.sqrt(0.5))):
        assert abs(of[name] - known) < 1e-3, (name, of[name])


@pytest.mark.full
def test_lengths_of_a_long_recording_are_known_better() -> None:
    """The variance of the mean of a stationary sequence, against that of many of them."""
    rng = np.random.default_rng(0)
    means = SHIFT * np.stack([stationary(rng, (2000,), SHIFTS_LAST).mean(0) for _ in range(5)])
    told = mean_deviation(np.full(FRAMES, 1 / RATE))
    assert abs(means.std() / told - 1) < 4 / np.sqrt(2 * means.size) + 1 / FRAMES
    assert mean_deviation(np.full(1, 1 / RATE)) == SHIFT


@pytest.mark.full
def test_what_was_measured_is_not_exact(scene: Scene[PointData]) -> None:
    """Angles are known less well, by some degrees where a length alone tells them; places nearly as well."""
    told = scene._replace(data=scene.data._replace(found={"lengths measured": True}))
    spreads = {}
    for measured, seen in ((False, scene), (True, told)):
        tree = smooth(track(seen, TrackSettings(filter="kalman")), SmoothSettings("laplace", errors="lasting"))
        spreads[measured] = [tree[f"summary/{name}_sd"].to_numpy() for name in ("state", "markers")]
    angles, places = (np.median(with_lengths / exact) for exact, with_lengths in zip(*spreads.values(), strict=True))
    assert 1.02 < angles < 1.5 and 0.99 < places < 1.1, (angles, places)


@pytest.mark.slow
def test_intervals_contain_errors_of_the_cameras_poses() -> None:
    """Five walks in three cameras with errors drawn from the prior: coverage of places over walks, within 3 standard errors."""
    noise, subject = 4.0, walking_subject(frames=f"0:{FRAMES}", rate=RATE)
    calibrated = cameras_about(subject, 1500.0)
    held: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(5):
        rng = np.random.default_rng(seed)
        turn, shift = PRIOR_ANGLE * rng.standard_normal((3, 3)), PRIOR_POSITION * rng.standard_normal((3, 3))
        true = moved_cameras(calibrated, jnp.asarray(turn, float), jnp.asarray(shift, float))
        places, points = detected(rng, subject, true, noise)
        refined = bundle_adjust(calibrated, points, np.ones(points.shape[:3]), noise, RATE)
        for known in (True, False):
            told = {"camera covariance": refined.covariance.tolist()} if known else {}
            data = PointData(points, np.full(points.shape[1:3], noise), told)
            seen = Scene(
                subject.body, refined.cameras, ("a", "b", "c"), data, np.arange(FRAMES), RATE, "", subject.states, places
            )
            tree = smooth(track(seen, TrackSettings(filter="kalman")), SmoothSettings("laplace", errors="lasting"))
            held[known].append(float(shares_held(tree, seen).mean()))
    error = np.std(held[True], ddof=1) / np.sqrt(5)
    assert abs(np.mean(held[True]) - 0.9) < 3 * max(error, 0.03), held
    assert np.mean(held[False]) < 0.5, held
