"""A learned activity as a tracker's prior: what it is given, and what it is refused for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.diagnostics.verdicts import verdicts
from poseppl.errors import InputError
from poseppl.filters.suitability import compatible_filters
from poseppl.motion.learned import (
    TrainingSettings,
    bin_angles,
    learn_factored_motion,
    pose_recording,
    read_recording,
    train_motion_model,
    write_factored_motion,
    write_motion_model,
)
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.tracking import TrackSettings, make_problem, observe_motion, track
from poseppl.motion.tracking.learned_prior import with_prior
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.motion.tracking.problem import problem_of_result
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.full

BODY = "poseppl_models.darby.marker_body:full_body"
VIDEO_BODY = "poseppl_models.bodies.choo_fleet:full_body"


def learn(data_dir, body, path):
    """Write a file of five phases of one person's walk, at 20 frames a second."""
    recording = pose_recording(read_recording(data_dir / "cmu_walks" / "16_15.amc"), body, 20.0)
    write_motion_model(train_motion_model([recording], body, TrainingSettings(num_states=5, num_rounds=5)), path)
    return path


@pytest.fixture(scope="module")
def learned(data_dir, tmp_path_factory):
    return learn(data_dir, BODY, tmp_path_factory.mktemp("learned") / "walk.nc")


@pytest.fixture(scope="module")
def learned_for_videos(data_dir, tmp_path_factory):
    """Prior of the body that videos are tracked with."""
    return learn(data_dir, VIDEO_BODY, tmp_path_factory.mktemp("learned") / "walk28.nc")


@pytest.fixture(scope="module")
def learned_tables(data_dir, tmp_path_factory):
    """The same walk as tables."""
    path = tmp_path_factory.mktemp("learned") / "tables.nc"
    recording = pose_recording(read_recording(data_dir / "cmu_walks" / "16_15.amc"), BODY, 20.0)
    write_factored_motion(learn_factored_motion(recording, BODY), path)
    return path


def scene_of(data_dir, model=BODY, frames="0:36:12"):
    folder = data_dir / "cmu_walks"
    subject = recorded_subject(folder / "16_16.amc", folder / "16.asf", model=model, frames=frames)
    return observe_motion(subject, cameras_around(subject), camera_names(1))


@pytest.mark.slow
def test_poses_of_states_are_the_start(data_dir, learned):
    """At the first frame's features and residual, the pose is the one that it started from; A is squared at half the rate."""
    scene = scene_of(data_dir)
    problem = with_prior(make_problem(scene), scene, learned)
    assert problem.model.finite_sites == ("phase",) and problem.model.dimension == 1 + 4 + 9 + 22
    activity = problem.inputs.activity.value
    np.testing.assert_allclose(activity.transition.sum(1), 1.0, atol=1e-5)
    start = np.asarray(scene.states[0])
    free = np.array([name.startswith(("pelvis", "neck")) for name in scene.body.tree.coordinate_names])
    sites = {"phase": 0, "features": np.zeros(4), "residual": start[~free] - np.asarray(activity.centre)}
    sites |= {"pelvis_position": start[:3], "pelvis": start[3:6], "neck": start[free][6:]}
    x = problem.model.to_flat(sites)
    inputs = type(problem.inputs)(*([None] * 6), activity)
    np.testing.assert_allclose(problem.pose(x, inputs), start, rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_frames_of_other_motion_are_reported(data_dir, learned):
    """Somebody who strikes does not walk; without other motion in the prior there is no probability of it."""
    scene = scene_of(data_dir)
    problem = with_prior(make_problem(scene), scene, learned)
    assert problem.follows is not None and len(problem.inputs.activity.value.means) == 6
    alone = with_prior(make_problem(scene), scene, learned, other_motion=False)
    assert alone.follows is None and len(alone.inputs.activity.value.means) == 5
    folder = data_dir / "cmu_amc"
    subject = recorded_subject(folder / "02_05.amc", folder / "02.asf", model=BODY, frames="300:540:6")
    punch = observe_motion(subject, cameras_around(subject), camera_names(1))
    found = track(punch, TrackSettings(model=BODY, filter="switching", prior=str(learned))).result
    probability = found["summary/prior_mean"].values
    assert probability.shape == (40,) and probability[20:].max() < 0.5
    assert "explained" not in found["predictive"] and np.isfinite(found["predictive/innovation"].values).all()
    scales = found["inputs/step_scale"].values[0]
    assert (scales[:6] > 0).all() and (scales == 0).sum() == 22
    assert any("The learned prior does not fit" in verdict.text for verdict in verdicts(found))


def test_what_a_prior_is_not_for(data_dir, learned):
    for scene, words in (
        (
            scene_of(data_dir, "poseppl_models.bodies.choo_fleet:full_body"),
            "model: it was learned with the body poseppl_models.darby.marker_body",
        ),
        (scene_of(data_dir, frames="0:20:4"), "of 20 frames a second, the scene of 30"),
    ):
        with pytest.raises(InputError, match=words):
            with_prior(make_problem(scene), scene, learned)
    scene = scene_of(data_dir)
    for setting in ({"walk": "learned"}, {"sigma_angle": 0.5}):
        with pytest.raises(InputError, match="walk is the prior's own"):
            track(scene, TrackSettings(model=BODY, filter="switching", prior=str(learned), **setting))
    with pytest.raises(InputError, match="frames are missing"):
        with_prior(make_problem(scene), scene._replace(frames=np.array([0, 1, 3])), learned)


@pytest.mark.slow
@pytest.mark.usefixtures("chdir_tmp")
def test_a_walk_is_tracked_by_what_was_learned(data_dir, learned):
    folder = data_dir / "cmu_walks"
    arguments = ["track", str(folder / "16_16.amc"), "--skeleton", str(folder / "16.asf"), "--frames", "0:120:6", "-q"]
    assert main([*arguments, "--prior", str(learned), "-o", "out.nc"]) == 0
    tree = load_result("out.nc")
    known = provenance(tree)
    assert known["filter"] == "switching" and known["model"] == BODY and known["prior"] == str(learned)
    error = tree["summary/markers_mean"].values - tree["truth/markers"].values
    assert np.nanmean(np.linalg.norm(error, axis=-1)) < 60
    with pytest.raises(InputError, match="learned prior"):
        problem_of_result(tree)


def test_tables_start_from_the_pose_and_are_of_one_rate(data_dir, learned_tables):
    """The likeliest first bins hold the first pose's angles, and the root walks by twice the recorded steps."""
    scene = scene_of(data_dir)._replace(rate=20.0)
    problem = with_prior(make_problem(scene), scene, learned_tables)
    assert problem.model.finite_sites == ("phase", "bins") and problem.follows is None
    start, activity = np.asarray(scene.states[0]), problem.inputs.activity.value
    rotations = np.delete(np.arange(31), [0, 1, 2, 3])
    likeliest = np.asarray(bin_angles(np.argmax(activity.first_bins[np.argmax(activity.first_phase)], -1)))
    apart = np.abs((likeliest - start[rotations] + np.pi) % (2 * np.pi) - np.pi)
    assert np.median(apart) < np.radians(3.0)
    scales = np.asarray(problem.inputs.step_scale)[0]
    assert (scales[:4] > 0).all() and (scales[4:] == 0).all()
    with pytest.raises(InputError, match="of 20 frames a second, the scene of 30"):
        with_prior(make_problem(scene), scene._replace(rate=30.0), learned_tables)


@pytest.mark.slow
@pytest.mark.usefixtures("chdir_tmp")
def test_a_walk_is_tracked_and_smoothed_by_tables(data_dir, learned_tables, tmp_path, capsys):
    """Nearer than the prior alone; a result needs the file of its prior again, and no other, to be smoothed."""
    folder = data_dir / "cmu_walks"
    arguments = ["track", str(folder / "16_16.amc"), "--skeleton", str(folder / "16.asf"), "--frames", "0:72:6", "-q"]
    few = ["--set", "num_particles=1000"]
    assert main([*arguments, "--prior", str(learned_tables), *few, "-o", "out.nc"]) == 0
    tree = load_result("out.nc")
    assert provenance(tree)["filter"] == "particle" and tree["filter_history/state"].dims[-1] == "filter_state_dim"
    error = tree["summary/markers_mean"].values - tree["truth/markers"].values
    assert np.nanmean(np.linalg.norm(error, axis=-1)) < 80
    for given, words in (
        ([], "--prior FILE, the prior's file"),
        (["--prior", "out.nc"], "tracked with another prior"),
        (["--prior", str(learned_tables), "--errors", "lasting"], "independent errors"),
    ):
        assert main(["smooth", "out.nc", "--method", "forward-backward", *given, "-q"]) == 1
        assert words in " ".join(capsys.readouterr().err.split())
    assert main(["smooth", "out.nc", "--method", "forward-backward", "--prior", str(learned_tables), "-q"]) == 0
    smoothed = load_result("out-forward-backward.nc")
    last = smoothed["summary/markers_mean"].values[-1]
    np.testing.assert_allclose(last, tree["summary/markers_mean"].values[-1], atol=0.01)  # which no later data change
    assert np.abs(smoothed["summary/markers_mean"].values - tree["summary/markers_mean"].values).max() > 1.0


@pytest.mark.slow
def test_one_cameras_silhouettes_tell_a_walk_that_was_learned(data_dir, learned_for_videos):
    """Joints within 50 mm of the truth's, relative to the pelvis, where a random walk leaves twice as much."""
    pytest.importorskip("cv2", reason="needs pip install 'poseppl[vision]'")
    from silhouette_rooms import RECORDS, body, masks_of

    from poseppl.motion.silhouettes.scene import silhouette_scene

    folder = data_dir / "cmu_walks"
    recorded = recorded_subject(folder / "16_16.amc", folder / "16.asf", model=VIDEO_BODY, frames="0:120:6")
    states = recorded.states - np.append(recorded.states[:, :2].mean(0), np.zeros(26))
    states[:, 2] += body().rest[2] - states[:, 2].mean()
    masks = {"left": np.stack([masks_of(state)["left"] for state in states])}
    seen = silhouette_scene(body(), RECORDS[:1], masks)._replace(states=states, markers=body().places(states), rate=20.0)
    model = with_prior(make_problem(seen), seen, learned_for_videos).model
    assert compatible_filters(model) == ("rao-blackwellised",)  # where a frame's pictures are one for all particles
    errors = []
    for settings in ({"filter": "switching", "prior": str(learned_for_videos)}, {"filter": "kalman"}):
        tree = track(seen, TrackSettings(model="poseppl_models.bodies.silhouettes:full_body", **settings)).result
        apart = tree["summary/markers_mean"].values - tree["truth/markers"].values
        errors.append(np.linalg.norm(apart - apart[:, :1], axis=-1).mean())
    assert errors[0] < 50 and errors[1] > 2 * errors[0], errors


@pytest.fixture
def chdir_tmp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
