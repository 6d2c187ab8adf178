"""The random walk's scales per square root of a second, so that no result depends on the rate."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from poseppl.errors import InputError
from poseppl.gaussians.linearisation import Gaussian
from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import write_observations
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, make_problem, observe_motion, problem_of_result, scene_of_observations, track
from poseppl.motion.tracking.observations import observations_of_scene
from poseppl.motion.tracking.placing import cameras_around, cameras_of_records, place_cameras, records_of_cameras
from poseppl.motion.tracking.problem import body_inputs
from poseppl.motion.tracking.velocity_learning import with_velocities
from poseppl.motion.tracking.walk import (
    MEMORY,
    SIGMA_ANGLE,
    SIGMA_POSITION,
    SPREAD,
    UNEVEN,
    VELOCITY_LASTS,
    step_scales,
    time_steps,
    velocity_steps,
)
from poseppl.motion.tracking.walk_learning import Expansion, expected_steps, learn_walk
from poseppl.motion.verdicts.steps import of_walk
from poseppl.program import StateSpaceModel
from poseppl.runs.run import frame_inputs

ARM = "poseppl_models.bodies.choo_fleet:arm"


def scene_of(rate: float, frames: str, model: str = ARM):
    subject = walking_subject(model, frames=frames, rate=rate)
    return observe_motion(subject, place_cameras(subject.markers[:, 0], 0.0), ("camera",))


def variance_of_a_second(problem) -> np.ndarray:
    """Sum of the covariances of the steps that the program makes after the first frame."""
    inputs = [frame_inputs(problem.inputs, frame) for frame in range(1, len(problem.observations.values["points"]))]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *inputs)
    moments = jax.vmap(problem.model.transition_moments, (None, 0))
    return np.asarray(jnp.diagonal(moments(jnp.zeros(problem.model.dimension), stacked)[1].sum(0)))


@pytest.mark.full
@pytest.mark.parametrize(("rate", "frames"), [(30.0, "0:31"), (60.0, "0:61"), (120.0, "0:121"), (120.0, "0:121:8")])
def test_the_motion_of_a_second_has_one_variance_at_any_rate(rate: float, frames: str) -> None:
    scene = scene_of(rate, frames)
    np.testing.assert_allclose(variance_of_a_second(make_problem(scene)), SIGMA_ANGLE**2, rtol=1e-4)
    a_frame = scene._replace(rate=30.0)  # 0.15 radians a frame, whatever the rate
    wrong = variance_of_a_second(make_problem(a_frame))
    assert (len(scene.frames) == 31) == np.allclose(wrong, SIGMA_ANGLE**2, rtol=1e-4)


@pytest.mark.full
def test_at_30_hz_the_steps_are_the_published_ones() -> None:
    scene = scene_of(30.0, "0:4", "poseppl_models.bodies.choo_fleet:full_body")
    steps = make_problem(scene).record()["step_scale"]
    np.testing.assert_allclose(steps, np.tile(np.where(np.arange(28) < 3, 15.0, 0.15), (4, 1)), rtol=1e-6)
    assert np.array([SIGMA_POSITION, SIGMA_ANGLE]) == pytest.approx([82.158, 0.82158], rel=1e-4)


def test_steps_over_gaps_are_wider() -> None:
    np.testing.assert_allclose(time_steps([7], 50.0), [0.02])
    np.testing.assert_allclose(time_steps([3, 5, 7, 13, 15], 10.0), [0.1, 0.1, 0.1, 0.3, 0.1])
    np.testing.assert_allclose(time_steps([0, 1], None), [1 / 30, 1 / 30])
    scene = scene_of(30.0, "0:4")
    gap = scene._replace(frames=np.array([0, 1, 5, 6]))
    steps = make_problem(gap).record()["step_scale"]
    np.testing.assert_allclose(steps / steps[0], np.tile([[1], [1], [2], [1]], (1, 4)), rtol=1e-6)
    whole = step_scales(scene.body, {"sigma_position": 10.0, "sigma_angle": 2.0}, [0.25, 1.0])
    np.testing.assert_allclose(whole[:, [0, 2, 3, 27]], [[5, 5, 1, 1], [10, 10, 2, 2]])


@pytest.mark.full
def test_the_scales_that_are_asked_for_are_used_recorded_and_smoothed_with() -> None:
    """Without data the variance grows by that of the steps; the first frame has data."""
    scene = scene_of(60.0, "0:5")
    scene.data.points[1:] = np.nan
    draws = 4000
    settings = TrackSettings(ARM, "kalman", {"num_particles": draws}, sigma_angle=0.6)
    tree = track(scene, settings).result
    expected = 0.6 / np.sqrt(60.0)
    assert tree["inputs/step_scale"].dims == ("frame", "state_dim")
    np.testing.assert_allclose(tree["inputs/step_scale"], expected, rtol=1e-6)
    variance = tree["summary/state_sd"].values ** 2
    grown = (variance[4] - variance[0]) / 4
    np.testing.assert_allclose(grown, expected**2, atol=5 * np.sqrt(2 / draws) * (variance[0] + variance[4]).max() / 4)
    assert np.all(np.abs(grown / (SIGMA_ANGLE**2 / 60.0) - 1) > 0.3)  # of the scales that nobody asked for
    problem = problem_of_result(tree)
    np.testing.assert_allclose(problem.record()["step_scale"], expected, rtol=1e-6)
    np.testing.assert_allclose(variance_of_a_second(problem), 4 * expected**2, rtol=1e-5)


@pytest.mark.full
def test_learned_scales_are_those_of_the_motion() -> None:
    """A body that walks at random is found to do so, by the scales that it was given; scales of others differ."""
    rng, frames, seconds = np.random.default_rng(0), 160, 1 / 60
    scene = scene_of(60.0, f"0:{frames}")
    body = scene.body
    sigma = {"shoulder_r": 0.4, "elbow_r": 1.6}
    free = list(body.free_coordinates)
    scales = np.array([sigma[body.tree.coordinates[index][0]] for index in free])
    states = np.tile(body.rest, (frames, 1))
    states[1:, free] += np.cumsum(rng.normal(size=(frames - 1, 4)) * scales * np.sqrt(seconds), axis=0)
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(jnp.asarray(states)), np.float64)
    subject = walking_subject(ARM, frames=f"0:{frames}", rate=60.0)._replace(states=states, markers=markers)
    seen = observe_motion(subject, cameras_around(subject, count=2), ("a", "b"), noise=3e-4)
    learned = learn_walk(make_problem(seen)).record()["step_scale"] / np.sqrt(seconds)
    # steps that were seen almost without noise: a standard deviation has a relative error of 1 / sqrt(2 n), n steps of a group
    count = np.where(scales == 0.4, 3, 1) * (frames - 1)
    np.testing.assert_allclose(learned / scales, 1.0, atol=float(5 / np.sqrt(2 * count.min())))
    assert np.all(np.abs(learned[0] / scales - 1) < 5 / np.sqrt(2 * count))
    assert np.all(np.abs(SIGMA_ANGLE / scales - 1) > 5 / np.sqrt(2 * count))


@pytest.mark.parametrize("reverts", [False, True], ids=["random walk", "mean-reverting"])
def test_smoothing_a_walk_in_expansions_is_the_kalman_smoother(reverts: bool) -> None:
    """Expected squares of steps against the joint Gaussian of a whole trajectory, by its precision matrix."""
    rng, frames, d = np.random.default_rng(1), 5, 2
    steps = rng.uniform(0.5, 2.0, (frames, d))
    roots = rng.normal(size=(frames, d, d))
    roots[2] = 0.0  # a frame without data
    information, vector = roots @ roots.swapaxes(1, 2), rng.normal(size=(frames, d))
    first = Gaussian(jnp.asarray([1.0, -1.0]), jnp.asarray([[2.0, 0.3], [0.3, 1.0]]))
    kept = rng.uniform(0.3, 0.9, (frames, d)) if reverts else np.ones((frames, d))
    offset = rng.normal(size=(frames, d)) if reverts else np.zeros((frames, d))
    precision, right = np.zeros((frames * d, frames * d)), (vector * (np.arange(frames) != 2)[:, None]).copy()
    for t in range(frames):
        at, before = slice(t * d, t * d + d), slice(t * d - d, t * d)
        precision[at, at] += information[t]
        if t == 0:
            precision[at, at] += np.linalg.inv(first.covariance)
            right[0] += np.linalg.solve(first.covariance, first.mean)
            continue
        inverse, left = np.diag(steps[t] ** -2.0), np.diag(kept[t])
        for one, other, factor in ((at, at, np.eye(d)), (before, before, left**2), (at, before, -left), (before, at, -left)):
            precision[one, other] += factor @ inverse
        right[t] += inverse @ offset[t]
        right[t - 1] -= left @ inverse @ offset[t]
    covariance = np.linalg.inv(precision)
    mean = (covariance @ right.ravel()).reshape(frames, d)
    difference = np.eye(frames * d)[d:] - kept[1:].reshape(-1, 1) * np.eye(frames * d)[:-d]
    moved = mean[1:] - kept[1:] * mean[:-1] - offset[1:]
    expected = moved**2 + np.diag(difference @ covariance @ difference.T).reshape(frames - 1, d)
    given = Expansion(jnp.asarray(vector * (np.arange(frames) != 2)[:, None]), jnp.asarray(information))
    means, squares = expected_steps(first, given, *map(jnp.asarray, (steps, kept, offset)))
    np.testing.assert_allclose(means, mean, rtol=2e-4, atol=1e-5)
    np.testing.assert_allclose(squares, expected, rtol=2e-4)


def after_a_second(rate: int) -> np.ndarray:
    """Covariance of place and velocity a second after a known place, the velocity having been stationary."""
    kept, step, way = (float(each[0]) for each in velocity_steps(np.array([1 / rate])))
    moves, covariance = np.array([[1.0, step * (1 + kept)], [0.0, kept]]), np.diag([0.0, 1.0])
    along = np.array([step, 1.0])
    noise = np.diag([way**2, 0.0]) + (1 - kept**2) * np.outer(along, along)
    for _ in range(rate):
        covariance = moves @ covariance @ moves.T + noise
    return covariance


def test_a_walk_with_velocities_is_the_same_at_any_rate() -> None:
    """Its variance is that of integrated Ornstein-Uhlenbeck velocities, and that of what goes along none."""
    one, s = after_a_second(1), VELOCITY_LASTS
    for rate in (7, 30, 120):
        np.testing.assert_allclose(after_a_second(rate), one, rtol=1e-9)
    np.testing.assert_allclose(one[0, 0], 2 * s * (1 + UNEVEN) - 2 * s**2 * (1 - np.exp(-1 / s)), rtol=1e-9)
    np.testing.assert_allclose(one[1, 1], 1.0, rtol=1e-9)


@pytest.mark.full
def test_learned_velocities_are_those_of_the_motion() -> None:
    """A body that keeps its velocities for a while is found to do so, by the scales that it was given."""
    rng, frames, seconds = np.random.default_rng(0), 300, 1 / 30
    scene = scene_of(30.0, f"0:{frames}")
    body, free = scene.body, list(scene.body.free_coordinates)
    scales = np.array([{"shoulder_r": 0.5, "elbow_r": 0.8}[body.tree.coordinates[index][0]] for index in free])
    kept, step, way = (each[0] for each in velocity_steps(np.array([seconds])))
    states, speed = np.tile(body.rest, (frames, 1)), scales * rng.normal(size=4)
    for t in range(1, frames):
        new = kept * speed + np.sqrt(1 - kept**2) * scales * rng.normal(size=4)
        states[t, free] = states[t - 1, free] + step * (speed + new) + way * scales * rng.normal(size=4)
        speed = new
    markers = np.asarray(jax.vmap(lambda x: marker_positions(body.tree, x))(jnp.asarray(states)), np.float64)
    subject = walking_subject(ARM, frames=f"0:{frames}", rate=30.0)._replace(states=states, markers=markers)
    seen = observe_motion(subject, cameras_around(subject, count=2), ("a", "b"), noise=3e-4)
    problem = make_problem(seen)
    inputs = body_inputs(with_velocities(problem, np.full(frames, seconds)))
    learned = np.asarray(inputs.velocities.scale.value)[free]
    count = np.where(scales == 0.5, 3, 1) * frames
    assert np.all(np.abs(learned / scales - 1) < 5 / np.sqrt(2 * count))
    np.testing.assert_allclose(np.asarray(inputs.step_scale)[0, free], way * learned, rtol=1e-5)
    given = np.asarray(body_inputs(problem.inputs).step_scale)[0, free] / np.sqrt(2 * VELOCITY_LASTS * seconds)
    assert np.all(np.abs(given / scales - 1) > 5 / np.sqrt(2 * count))


@pytest.mark.full
def test_a_learned_walk_is_recorded_and_smoothed_with() -> None:
    scene = scene_of(120.0, "0:20")
    settings = TrackSettings(ARM, "kalman", {"num_particles": 20}, walk="learned")
    tree = track(scene, settings).result
    recorded = tree["inputs/step_scale"].values
    expected = learn_walk(make_problem(scene)).record()["step_scale"]
    np.testing.assert_allclose(recorded, expected, rtol=1e-5)
    assert np.all(recorded < 0.9 * SIGMA_ANGLE / np.sqrt(120.0))  # a walk's arm swings less than the prior thinks
    np.testing.assert_array_equal(problem_of_result(tree).record()["step_scale"], recorded)
    with pytest.raises(InputError, match="^walk: 'learnt'"):
        track(scene, replace(settings, walk="learnt"))


@pytest.mark.parametrize("rate", [30.0, 120.0])
def test_a_mean_reverting_walk_is_that_of_an_ornstein_uhlenbeck_process(rate: float) -> None:
    """Mean and variance of a second, from a known state, in closed form; the root walks on."""
    scene = scene_of(rate, f"0:{int(rate) + 1}", "poseppl_models.bodies.choo_fleet:full_body")
    problem = make_problem(scene, mean_reverting=True)
    moments = jax.jit(problem.model.transition_moments)
    body, first = scene.body, np.linspace(-1.0, 1.0, 28)
    mean, variance = jnp.asarray(first), jnp.zeros(28)
    for frame in range(1, int(rate) + 1):
        inputs = frame_inputs(problem.inputs, frame)
        mean, step = moments(mean, inputs)
        variance = inputs.posture.kept**2 * variance + jnp.diagonal(step)
    held = [body.postures.get(coordinate) for coordinate in body.tree.coordinates]
    known = np.array([posture is not None for posture in held])
    centre, spread = np.array([posture or (0.0, 0.0) for posture in held]).T
    left = np.exp(-1 / MEMORY)
    np.testing.assert_allclose(mean, np.where(known, centre + left * (first - centre), first), rtol=1e-4, atol=1e-5)
    walked = np.array([SIGMA_POSITION] * 3 + [SIGMA_ANGLE] * 25) ** 2
    np.testing.assert_allclose(variance, np.where(known, (SPREAD * spread) ** 2 * (1 - left**2), walked), rtol=1e-4)
    assert known.sum() == 21 and not known[:6].any()


@pytest.mark.full
def test_a_mean_reverting_walk_is_recorded_and_smoothed_with() -> None:
    scene = scene_of(60.0, "0:20")
    settings = TrackSettings(ARM, "kalman", {"num_particles": 20}, walk="mean-reverting")
    tree = track(scene, settings).result
    expected = make_problem(scene, mean_reverting=True).record()
    assert [each.value for each in of_walk(tree, "raise {}", "sigma_angle")] == ["learned", "fixed"]
    again = problem_of_result(tree)
    for name, values in expected.items():
        np.testing.assert_array_equal(again.record()[name], values, err_msg=name)
    learned = learn_walk(make_problem(scene)).record()["step_scale"]
    assert np.all(np.abs(expected["step_scale"] / learned - 1) > 0.05)  # angles that come back keep their steps
    body = scene.body._replace(postures={})
    with pytest.raises(InputError, match="walk: this body has no usual posture"):
        make_problem(scene._replace(body=body), mean_reverting=True)


@pytest.mark.full
def test_a_transition_that_is_no_random_walk_is_refused() -> None:
    scene = scene_of(30.0, "0:3", "poseppl_models.bodies.choo_fleet:full_body")

    def transition(params, state, inputs):
        for name, value in state.items():
            numpyro.sample(name, dist.Normal(0.9 * value, 0.1))

    program = scene.body.program
    body = scene.body._replace(program=StateSpaceModel(program.initial, transition, program.observation))
    with pytest.raises(InputError, match="walk: the walk of this body cannot be learned: its transition is not the random"):
        learn_walk(make_problem(scene._replace(body=body)))


def test_the_rate_of_observations_is_that_of_the_frames_that_are_taken(tmp_path) -> None:
    subject = walking_subject(frames="0:7", rate=60.0)
    records = records_of_cameras(place_cameras(subject.markers[:, 0], 0.0), 1500.0, (1920, 1080))
    scene = observe_motion(subject, cameras_of_records(records), ("camera",))
    write_observations(tmp_path / "points.csv", observations_of_scene(scene))
    for rate, seconds in ((60.0, 2 / 60), (None, 1 / 30)):
        again = scene_of_observations(tmp_path / "points.csv", records, frames="0:7:2", rate=rate)
        assert again.rate == (30.0 if rate else None)
        np.testing.assert_allclose(time_steps(again.frames, again.rate), seconds)


@pytest.mark.full
def test_a_few_frames_of_a_circle_are_those_of_a_longer_one():
    few, more = (walking_subject(frames=f"0:{count}", rate=60.0, turn=1200.0) for count in (5, 120))
    np.testing.assert_allclose(few.states, more.states[:5], atol=1e-6)
    np.testing.assert_allclose(few.markers, more.markers[:5], atol=1e-3)
    assert few.frames.tolist() == [0, 1, 2, 3, 4]
