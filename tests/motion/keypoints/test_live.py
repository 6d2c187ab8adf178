"""A person who is tracked frame by frame, on a real recording: the same as in one go."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.io import DetectedPeople, read_calibration, read_cameras
from poseppl.motion.io.growing_folders import KeypointFrame
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.io.keypoints import read_frame
from poseppl.motion.keypoints.live import LiveTrack, sees_someone
from poseppl.motion.keypoints.people import FollowedPerson, associate_person
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings, LiveSettings
from poseppl.motion.tracking import TrackSettings, track
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import MIN_CONFIDENCE
from poseppl.runs.run import run_filter

SETTINGS = TrackSettings(filter="kalman", max_draws=50)
FRAMES = 10


@pytest.fixture
def folders(data_dir: Path) -> dict[str, Path]:
    return {f"cam_0{c}": data_dir / "pose2sim_balancing" / "pose" / f"cam0{c}_json" for c in (1, 2, 3, 4)}


@pytest.fixture
def calibration(data_dir: Path) -> Any:
    return read_calibration(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml", "m")


@pytest.fixture
def frames(folders: dict[str, Path]) -> list[KeypointFrame]:
    files = zip(*(sorted(folder.glob("*.json"))[:FRAMES] for folder in folders.values()), strict=True)
    return [KeypointFrame(number, tuple(map(read_frame, row)), 0.0) for number, row in enumerate(files)]


def arrays(tree: Any) -> dict[str, Any]:
    """All that a result holds, but for how long it took."""
    return {f"{group.path}/{name}": values.to_numpy() for group in tree.subtree for name, values in group.data_vars.items()}


def same(one: Any, other: Any) -> None:
    first, second = arrays(one), arrays(other)
    assert first.keys() == second.keys() and "/summary/markers_mean" in first
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


@pytest.mark.usefixtures("optimised")  # otherwise the same numbers of two programs differ by rounding
@pytest.mark.full
@pytest.mark.parametrize("count", [4, 1])
def test_first_frames_alone_are_what_the_filter_gives(
    folders: dict[str, Path], calibration: Any, frames: list[KeypointFrame], count: int
) -> None:
    folders = dict(list(folders.items())[:count])
    frames = [each._replace(people=each.people[:count]) for each in frames]
    live = LiveTrack(LiveSettings(folders, calibration, rate=60.0), frames, SETTINGS, lambda note: None)
    how: Any = {"rate": 60.0, "keep": ("clocks", "detections"), "frames": f":{FRAMES}"}
    scene = scene_of_keypoints(KeypointSettings(folders, calibration, **how)).scene
    whole = track(scene, replace(SETTINGS, history_mib=0)).result  # which frames that come one by one do not keep
    same(live.finish(), whole)
    np.testing.assert_array_equal(live.estimate.mean, whole["summary"].dataset["markers_mean"])
    assert (live.estimate.lower <= live.estimate.upper).all()


@pytest.mark.usefixtures("optimised")  # otherwise the same numbers of two programs differ by rounding
@pytest.mark.full
def test_frames_one_by_one_are_what_a_run_of_them_gives_and_nothing_is_traced(
    folders: dict[str, Path], calibration: Any, frames: list[KeypointFrame], caplog: pytest.LogCaptureFixture
) -> None:
    notes: list[str] = []
    live = LiveTrack(LiveSettings(folders, calibration, rate=60.0), frames[:5], SETTINGS, notes.append)
    assert any("body25b" in note for note in notes)
    lost = frames[7]._replace(people=(frames[7].people[0], None, [], frames[7].people[3]))
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        first = live.add(frames[5])
        caplog.clear()
        means = [first.mean, *(live.add(frame).mean for frame in (frames[6], lost, *frames[8:]))]
        assert [record.getMessage() for record in caplog.records] == []
        jax.jit(lambda x: x + 1)(1.0)
        assert caplog.records  # they would be reported
    whole = live.whole()
    problem = whole.problem
    how: Any = {"collect": whole.collect, "predict": whole.predict, "num_frames": FRAMES}
    run = run_filter(whole.filter, jax.random.key(SETTINGS.seed), problem.observations, problem.inputs, **how)
    tree = live.finish()
    same(tree, whole.result(run))
    np.testing.assert_array_equal(np.concatenate(means), tree["summary"].dataset["markers_mean"][5:])
    assert np.isnan(tree["observed_data/points"].to_numpy()[7, 1:3]).all()
    seen, expected = (tree[name].to_numpy() for name in ("observed_data/points", "summary/points_mean"))
    assert np.nanmedian(np.linalg.norm(seen - expected, axis=-1)) < 20


@pytest.mark.full
def test_one_cameras_intervals_have_the_stature_in_them(
    folders: dict[str, Path], calibration: Any, frames: list[KeypointFrame]
) -> None:
    one = [frame._replace(people=frame.people[:1]) for frame in frames]
    live = LiveTrack(LiveSettings({"cam_01": folders["cam_01"]}, calibration, rate=60), one[:-1], SETTINGS, lambda note: None)
    last, tree = live.add(one[-1]), live.finish()
    kept = np.asarray(live.whole().problem.inputs.posture.kept)
    assert kept.min() < 1 and (kept == kept[0]).all() and len(kept) == FRAMES
    quantiles = tree["summary"].dataset["markers_quantile"]
    for level, first, ends in ((0.05, live.estimate.lower, last.lower), (0.95, live.estimate.upper, last.upper)):
        np.testing.assert_allclose(np.concatenate([first, ends]), quantiles.sel(quantile=level).values, atol=0.01)
    assert np.linalg.norm(last.upper - last.lower, axis=-1).max() > 300  # 0.18 of 3.3 m


def test_the_points_of_later_frames_are_those_of_a_recording(
    folders: dict[str, Path], calibration: Any, frames: list[KeypointFrame]
) -> None:
    """With the cameras as they are, all that the first frames tell of the points is whom they are of, and their errors."""
    live = LiveTrack(
        LiveSettings(folders, calibration, rate=60.0, keep=("calibration",)), frames[:5], SETTINGS, lambda note: None
    )
    for frame in frames[5:]:
        live.add(frame)
    how: Any = {"rate": 60.0, "keep": ("clocks", "calibration", "detections"), "frames": f":{FRAMES}"}
    found, data = scene_of_keypoints(KeypointSettings(folders, calibration, **how)), live.whole().scene.data
    np.testing.assert_array_equal(data.points, found.scene.data.points)
    first = scene_of_keypoints(KeypointSettings(folders, calibration, **{**how, "frames": ":5"})).point_errors
    assert first is not None
    cameras = found.scene.cameras
    places = triangulate(cameras, data.points, found.confidence)
    noise = first.noise(cameras, found.scene.body.tree.marker_names, places, np.clip(found.confidence, MIN_CONFIDENCE, 1.0))
    placed = np.broadcast_to(np.isfinite(places).all(-1)[:, None], noise.shape)
    np.testing.assert_allclose(data.noise[placed], noise[placed], rtol=1e-5)


def seen(people: Sequence[DetectedPeople], part: slice) -> list[DetectedPeople]:
    return [found._replace(points=found.points[part], confidence=found.confidence[part]) for found in people]


@pytest.mark.full
@pytest.mark.parametrize("person", [1, 2])
def test_a_person_is_followed_among_others(data_dir: Path, person: int) -> None:
    records = read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")
    people = [read_openpose(data_dir / "pose2sim_two_people" / f"cam0{c}_json") for c in (1, 2, 3, 4)]
    cameras = cameras_of_records(records)
    chosen = associate_person(cameras, people, 60.0, person)
    followed = FollowedPerson(cameras, seen(people, slice(10)), chosen[:10], 60.0)
    found = np.concatenate([followed.choose(seen(people, slice(t, t + 1))) for t in range(10, 100)])
    assert (found == chosen[10:]).mean() > 0.98


@pytest.mark.full
def test_nobody_is_reported(folders: dict[str, Path], calibration: Any, frames: list[KeypointFrame]) -> None:
    empty = [frame._replace(people=([], None, [], [])) for frame in frames]
    assert [sees_someone(frame) for frame in (frames[0], empty[0])] == [True, False]
    with pytest.raises(InputError, match=f"nobody was found in any of {FRAMES} frames"):
        LiveTrack(LiveSettings(folders, calibration, rate=60.0), empty, SETTINGS, lambda note: None)
