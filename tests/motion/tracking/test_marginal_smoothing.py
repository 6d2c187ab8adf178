"""Smoothing with marginalised errors against the programs that have them in the state, and a recording without a filter."""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.detected_points import FREEDOM

from poseppl.arrays import Floats
from poseppl.compilation import double_precision
from poseppl.errors import InputError
from poseppl.gaussians.block_tridiagonal import BlockTridiagonal, marginal_covariances, solve
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry import join_cameras, look_at, project
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import Scene, TrackSettings, make_problem, smooth_recording
from poseppl.motion.tracking.body_sizes import MeasuredLengths, lengths_per_place
from poseppl.motion.tracking.lasting_errors import with_ar1_noise
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import Problem
from poseppl.motion.tracking.recorded_model import offsets_of_lengths
from poseppl.motion.tracking.seen_body import SeenBody, seen_body
from poseppl.motion.tracking.triangulated_start import triangulated_places, triangulated_poses
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.smoothers.curvature import at_expected_errors, safe_cholesky, trajectory_precisions
from poseppl.smoothers.marginal_errors import Mode, find_mode, gaussian_around

RATE, FRAMES, NOISE = 30.0, 16, 0.004


def seen_walk(subject: MovingSubject) -> Scene[PointData]:
    """A walk in two cameras, with heavy-tailed noise; one camera loses a knee for a while, and nobody sees a wrist."""
    rng, middle = np.random.default_rng(1), subject.markers.reshape(-1, 3).mean(0)
    centres = middle + np.array([[4000.0, 0, 400], [-500, 4000, 800]])
    cameras = join_cameras([look_at(tuple(centre), tuple(middle)) for centre in centres])
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(subject.markers, float)), np.float64), 0, 1)
    points = clean + NOISE * rng.standard_normal(clean.shape) / np.sqrt(rng.chisquare(FREEDOM, clean.shape) / FREEDOM)
    names = subject.body.tree.marker_names
    points[:, :, names.index("wrist_l")] = np.nan
    points[5:11, 0, names.index("knee_r")] = np.nan
    data = PointData(points, np.full(points.shape[1:3], NOISE))
    return Scene(subject.body, cameras, ("a", "b"), data, np.arange(FRAMES), RATE, "", None, subject.markers)


@pytest.fixture(scope="module")
def scene() -> Scene[PointData]:
    return seen_walk(walking_subject(frames=f"0:{FRAMES}", rate=RATE))


class Solved(NamedTuple):
    """A scene's problem with lengths and cameras that are not exact, and the mode of its marginalised form."""

    problem: Problem
    body: SeenBody
    mode: Mode


@pytest.fixture(scope="module")
def solved(scene: Scene[PointData]) -> Solved:
    from poseppl_models.bodies.choo_fleet import full_body

    plain = make_problem(scene)
    places = triangulated_places(plain, scene.data.points)
    lengths = MeasuredLengths(offsets_of_lengths(scene.body, full_body), lengths_per_place(scene.body, scene.markers))
    covariance = np.diag(np.tile([0.002] * 3 + [5.0] * 3, 2)) ** 2
    problem = with_ar1_noise(plain, scene.frames, RATE, covariance, lengths)
    body = seen_body(problem.inputs, scene.data.points)
    poses = triangulated_poses(scene.body, places, np.full(FRAMES, 1 / RATE))
    return Solved(problem, body, find_mode(body.problem(), body.states(poses), least=1e-7))


def whole_states(solved: Solved) -> Floats:
    """The mode as states (T, d) of the programs."""
    problem, body, mode = solved
    cameras, markers, width = problem.num_cameras, len(body.tree.marker_names), body.dimension
    errors = np.zeros((FRAMES, cameras, markers, 2))
    errors[:, :, body.markers] = mode.errors.reshape(-1, cameras, FRAMES, 2).transpose(2, 1, 0, 3)
    parts = [
        mode.x[:, :width],
        body.shifts(mode.x),
        errors,
        mode.x[:, width : 2 * width],
        np.zeros((FRAMES, problem.num_static)),
    ]
    return np.concatenate([part.reshape(FRAMES, -1) for part in parts], 1)


@pytest.mark.full
def test_mode_and_standard_deviations_are_those_of_the_programs(solved: Solved) -> None:
    """A step from the mode, by the programs in float64, is below 0.1 mm and 1e-3 radians; deviations agree within 3 %.

    Those that are expected of errors are of 48 draws: on average over all, that is far less.
    """
    problem, body, mode = solved
    states, moving = whole_states(solved), problem.model.dimension - problem.num_static
    width = body.dimension
    with double_precision():
        sequence = frame_sequence(problem.observations, problem.inputs, None)
        data: Any = jax.tree.map(_double, (sequence.observations, sequence.stacked_inputs()))

        def about(spread: Any) -> Any:
            beside = jnp.pad(spread, ((0, 0), (0, problem.num_static), (0, problem.num_static)))
            whole = trajectory_precisions(problem.model, *data)(jnp.asarray(states), beside)
            cut = BlockTridiagonal(whole.diagonal[:, :moving, :moving], whole.below[:, :moving, :moving])
            return safe_cholesky(cut), whole.diagonal[:, :moving, moving:]

        def found() -> Any:
            factor, cross = at_expected_errors(about, jnp.asarray(states[:, :moving]))
            slope = jax.grad(lambda xs: problem.model.log_joint(xs, *data))(jnp.asarray(states))[:, :moving]
            response = jax.vmap(lambda column: solve(factor, column), in_axes=2, out_axes=2)(cross)
            return solve(factor, slope), jax.vmap(jnp.diag)(marginal_covariances(factor).own), response

        step, own, response = (np.asarray(each) for each in jax.jit(found)())
    told: Any = body.unchanging(mode.x)
    variance = own + np.square(response @ told.root).sum(-1)
    shifts = width + np.arange(3 * len(body.tree.marker_names)).reshape(-1, 3)[body.markers].ravel()
    order = np.r_[:width, moving - width : moving, shifts]
    lengths = np.isin(np.arange(moving), np.r_[:3, shifts])
    assert np.abs(step[:, lengths]).max() < 0.1 and np.abs(step[:, 3:width]).max() < 1e-3
    around = gaussian_around(body.problem(), mode, np.random.default_rng(0), 20, told)
    ratio = np.sqrt(around.variance / variance[:, order])
    assert abs(np.median(ratio) - 1) < 0.01 and np.quantile(np.abs(ratio - 1), 0.95) < 0.03, np.quantile(ratio, [0, 0.5, 1])


@pytest.mark.full
def test_noise_of_reduced_errors_has_the_covariance_of_their_information(solved: Solved) -> None:
    """Within five standard errors of 4000 draws, in a frame in which one camera misses a knee."""
    frame, count, walk = 6, 4000, solved.body.problem()
    view = solved.body.view(solved.mode.x)
    weight = np.where(walk.known[..., None, None], np.eye(2), 0.0)
    information = [each.copy() for each in view.reduced(weight, walk.ratio)[1]][frame]
    one = type(view)(view.moves[frame : frame + 1], view.by_place[frame : frame + 1])
    noise = one.reduced_noise(weight[:, frame : frame + 1], walk.ratio, np.random.default_rng(0), count)[0].astype(float)
    size = np.sqrt(np.diag(information))
    off = noise.T @ noise / count - information
    assert np.all(np.abs(off) <= 5 * np.outer(size, size) * np.sqrt(2 / count) + 1e-9)


def _double(leaf: Any) -> Any:
    return jnp.asarray(np.asarray(leaf, np.float64 if np.asarray(leaf).dtype.kind == "f" else None))


@pytest.mark.full
def test_a_recording_is_smoothed_without_a_filter(scene: Scene[PointData]) -> None:
    tree = smooth_recording(scene, TrackSettings(options={"num_draws": 60}, max_draws=20)).result
    assert tree["posterior"].sizes["draw"] == 20 and tree.attrs["num_particles"] == 60
    summary = tree["summary"].dataset
    names = list(scene.body.tree.marker_names)
    assert scene.markers is not None
    error = np.linalg.norm(summary["markers_mean"].values - scene.markers, axis=-1)
    assert np.median(error) < 25.0
    deviation = np.median(summary["markers_sd"].values, (0, 2))
    assert deviation[names.index("wrist_l")] > 3 * deviation[names.index("wrist_r")]  # which nobody sees
    drawn = tree["posterior/markers"].to_numpy()[0, 0]
    images = np.moveaxis(np.asarray(project(scene.cameras, jnp.asarray(drawn, float))), 0, 1)
    np.testing.assert_allclose(images, tree["posterior/points"].to_numpy()[0, 0], atol=1e-4)
    assert np.median(summary["spine_position_sd"]) > 0 and "filtered" not in tree.children


def test_one_camera_needs_a_filter(scene: Scene[PointData]) -> None:
    alone = scene._replace(camera_names=("a",))
    with pytest.raises(InputError, match="two cameras or more"):
        smooth_recording(alone)
