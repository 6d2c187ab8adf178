"""Scenes, cameras, starts, settings."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry import depth, marker_positions, project
from poseppl.motion.io import read_cameras, write_cameras, write_observations
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion, scene_of_observations, track
from poseppl.motion.tracking.body_result import BodyNames, body_result
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.observations import observations_of_scene
from poseppl.motion.tracking.placing import camera_names, cameras_of_records, place_cameras, records_of_cameras
from poseppl.motion.tracking.problem import make_problem, problem_of_result
from poseppl.motion.tracking.start import seek_start

WALK = walking_subject(frames="0:12")
PATH = WALK.markers[:, 0]


def test_cameras_stand_where_they_should() -> None:
    cameras = place_cameras(PATH, 0.0, distance=4000.0, count=2)
    ahead = np.asarray(depth(cameras, jnp.asarray(PATH)))
    np.testing.assert_allclose(ahead.min(1), 4000.0, atol=5.0)
    # the walk heads along +X: its right side is -Y, its front +X
    assert cameras.centre[0, 1] < -3900 and cameras.centre[1, 0] > 3900
    front = place_cameras(PATH, 0.0, view=0.0)
    assert front.centre[0, 0] > 4900
    standing = place_cameras(np.zeros((3, 3)), np.pi / 2, distance=1000.0, view=0.0)
    np.testing.assert_allclose(standing.centre[0], [-1000, 0, 0], atol=1.0)


@pytest.mark.full
def test_placed_cameras_are_written_and_read_back(tmp_path: Path) -> None:
    placed = place_cameras(PATH, 0.0, count=2)
    records = records_of_cameras(placed, 1500.0, (1920, 1080))
    write_cameras(tmp_path / "c.toml", records)
    cameras = cameras_of_records(read_cameras(tmp_path / "c.toml"))
    plain = project(placed, jnp.asarray(WALK.markers))
    expected = np.asarray(plain) * [1500.0, -1500.0] + [960.0, 540.0]
    np.testing.assert_allclose(project(cameras, jnp.asarray(WALK.markers)), expected, atol=0.05)


def test_a_camera_behind_the_subject_is_named() -> None:
    cameras = place_cameras(PATH, 0.0)
    turned = cameras._replace(rotation=-cameras.rotation)
    with pytest.raises(InputError, match="camera 'camera' has pelvis at or behind it in frame 0"):
        observe_motion(WALK, turned, ("camera",))


def test_noise_has_its_size_and_missing_points_are_missing() -> None:
    cameras = place_cameras(PATH, 0.0, focal=1000.0)
    scene = observe_motion(WALK, cameras, ("camera",), noise=0.003, missing=0.2, seed=1)
    clean = np.moveaxis(np.asarray(project(cameras, jnp.asarray(WALK.markers))), 0, 1)
    error = (scene.data.points - clean)[np.isfinite(scene.data.points)]
    assert abs(error.std() / 3.0 - 1) < 5 / np.sqrt(2 * error.size)
    missing = np.isnan(scene.data.points).all(-1).mean()
    assert abs(missing - 0.2) < 5 * np.sqrt(0.16 / (12 * 17))
    np.testing.assert_array_equal(
        scene.data.points, observe_motion(WALK, cameras, ("camera",), missing=0.2, seed=1).data.points
    )


@pytest.mark.full
@pytest.mark.parametrize("count", [1, 2])
def test_a_start_is_found_from_the_image_alone(count: int) -> None:
    cameras = place_cameras(PATH, 0.0, count=count)
    scene = observe_motion(WALK, cameras, camera_names(count), noise=1e-4)
    start = seek_start(scene.body, cameras, scene.data.points, scene.data.noise)
    shown = np.asarray(project(cameras, marker_positions(scene.body.tree, jnp.asarray(start))))
    assert np.abs(shown - scene.data.points[0]).max() < 0.01
    error = np.linalg.norm(np.asarray(marker_positions(scene.body.tree, jnp.asarray(start))) - WALK.markers[0], axis=-1)
    assert error.mean() < (300 if count == 1 else 40)


@pytest.mark.full
def test_observations_without_truth_are_tracked(tmp_path: Path) -> None:
    placed = place_cameras(PATH, 0.0)
    records = records_of_cameras(placed, 1500.0, (1920, 1080))
    scene = observe_motion(WALK, cameras_of_records(records), ("camera",), missing=0.1)
    write_observations(tmp_path / "points.csv", observations_of_scene(scene))
    again = scene_of_observations(tmp_path / "points.csv", records, frames="2:8:2", rate=30.0)
    np.testing.assert_array_equal(again.frames, [2, 4, 6])
    np.testing.assert_array_equal(again.data.points, scene.data.points[[2, 4, 6]])
    tree = track(again, TrackSettings(filter="particle", options={"num_particles": 200}, max_draws=20)).result
    assert "truth" not in tree.children
    assert tree["posterior/markers"].shape == (1, 20, 3, 17, 3)
    np.testing.assert_array_equal(tree["posterior"]["frame"], [2, 4, 6])


@pytest.mark.slow
def test_clamped_bodies_need_a_truth(tmp_path: Path) -> None:
    arm = walking_subject("poseppl_models.bodies.choo_fleet:arm", frames="0:3")
    scene = observe_motion(arm, place_cameras(PATH, 0.0), ("camera",))
    tree = track(scene, TrackSettings(filter="particle", options={"num_particles": 300}, max_draws=20)).result
    assert tree["predictive/transform"].shape == (tree["posterior"].sizes["frame"], scene.data.points[0].size)
    assert list(tree["unconstrained_posterior"]["state_dim"].values) == [
        "shoulder_r.Z",
        "shoulder_r.Y",
        "shoulder_r.X",
        "elbow_r.X",
    ]
    clamped = scene.body.tree.marker_names.index("pelvis")
    np.testing.assert_allclose(tree["summary/markers_mean"][:, clamped], arm.markers[:, clamped], atol=0.05)
    assert float(tree["diagnostics/joint_error"].mean()) < 50
    with pytest.raises(InputError, match="needs the truth"):
        scene_of_observations(tmp_path / "none.csv", (), model="poseppl_models.bodies.choo_fleet:arm")


@pytest.mark.parametrize("turn", [-2.5, 2.5])
def test_a_start_keeps_to_the_turn_of_the_rest(turn: float) -> None:
    """A heading found after most of a turn is reported as the smaller one the other way."""
    cameras = place_cameras(PATH, 0.0, count=2)
    state = np.asarray(WALK.body.rest).copy()
    state[:3] = WALK.states[0, :3]
    state[WALK.body.tree.coordinate_names.index("spine.Z")] += turn
    shown = np.asarray(project(cameras, marker_positions(WALK.body.tree, jnp.asarray(state))))[None]
    start = seek_start(WALK.body, cameras, shown, np.full(shown.shape[1:3], 1e-3))
    again = np.asarray(project(cameras, marker_positions(WALK.body.tree, jnp.asarray(start))))
    np.testing.assert_allclose(again, shown[0], atol=0.01)
    assert np.abs(start[3:] - np.asarray(WALK.body.rest)[3:]).max() <= np.pi


def test_a_low_confidence_widens_the_noise_and_none_hides_the_point(tmp_path: Path) -> None:
    records = records_of_cameras(place_cameras(PATH, 0.0), 1500.0, (1920, 1080))
    scene = observe_motion(WALK, cameras_of_records(records), ("camera",))
    confidence = np.full(scene.data.points.shape[:-1], 0.25)
    confidence[1], confidence[2] = 1.0, 0.01
    write_observations(tmp_path / "points.csv", observations_of_scene(scene)._replace(confidence=confidence))
    again = scene_of_observations(tmp_path / "points.csv", records, noise=0.003)
    np.testing.assert_allclose(again.data.noise[0], 2 * 0.003 * 1500.0)
    np.testing.assert_allclose(again.data.noise[1], 0.003 * 1500.0)
    assert np.isnan(again.data.points[2]).all() and np.isfinite(again.data.points[[0, 1, 3]]).all()


def test_the_problem_of_a_result_is_the_one_that_was_posed() -> None:
    scene = observe_motion(WALK, place_cameras(PATH, 0.0), ("camera",))
    posed = make_problem(scene)
    tree = body_result(
        state=np.zeros((1, 2, 12, 28)),
        names=BodyNames(scene.body.tree.coordinate_names, scene.body.tree.marker_names, scene.camera_names),
        observed={"points": scene.data.points},
        cameras={name: None if leaf is None else np.asarray(leaf) for name, leaf in scene.cameras._asdict().items()},
        inputs=posed.record(),
        frames=scene.frames,
        rate=scene.rate,
        attrs={"model": DEFAULT_MODEL, "lengths": dict(scene.body.lengths), "settings": {}},
    )
    again = problem_of_result(tree)
    expected, found = posed.record(), again.record()
    assert expected.keys() == found.keys()
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-5, err_msg=name)
    np.testing.assert_array_equal(again.observations.values["points"], posed.observations.values["points"])
