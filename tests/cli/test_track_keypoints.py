"""`poseppl track keypoints` on a real recording."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from balancing_options import words
from waiting import PATIENCE

from poseppl.cli import main
from poseppl.cli.checks import stem_of
from poseppl.cli.track_run import Wanted, goes_straight, planned
from poseppl.motion import track
from poseppl.motion.io import CameraRecord, open_video, write_cameras
from poseppl.motion.io.cameras import calibration_of
from poseppl.motion.io.trc import read_trc
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.settings import TrackSettings
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.usefixtures("here", "without_pictures")


@pytest.mark.full
def test_a_recording_is_tracked(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = ["--frames", "0:12:3", "--filter", "kalman", "--max-draws", "50", "-o", "out.nc"]
    assert main(["track", *words(data_dir, 1, 2, 3, 4), *small]) == 0
    told = "".join(capsys.readouterr())
    assert "the keypoints have the layout body25b" in told
    assert "its calibration is off by" in told
    assert re.search(r"out.nc: (info|warning|error): .*out-laplace.nc: (info|warning|error): ", told, re.DOTALL)
    tree = load_result("out.nc")
    assert tree["posterior"].sizes["frame"] == 4
    assert "pose/cam01_json" in provenance(tree)["input"]
    seen, expected = (np.asarray(tree[name].to_numpy()) for name in ("observed_data/points", "summary/points_mean"))
    assert np.nanmedian(np.linalg.norm(seen - expected, axis=-1)) < 20
    for name in ("out-laplace.trc", "out-laplace_lower.trc", "out-laplace_upper.trc", "out-laplace.mot", "out-laplace.osim"):
        assert name in told and Path(name).is_file()
    smoothed = read_trc("out-laplace.trc")
    np.testing.assert_allclose(smoothed.positions, load_result("out-laplace.nc")["summary/markers_mean"], atol=0.01)
    assert smoothed.rate == 20.0
    assert not list(Path().glob("out.[tm]*"))
    assert load_result("out-laplace.nc")["posterior/camera_error"].shape[2:] == (4, 24)
    video = data_dir / "pose2sim_balancing" / "videos" / "cam01.mp4"
    assert main(["overlay", "out-laplace.nc", f"cam_01={video}", "-q"]) == 0
    assert len(list(open_video("out-laplace-cam_01.mp4", "cam_01").images())) == 4
    for result in (tree, load_result("out-laplace.nc")):  # what the report's table of cameras shows
        found = provenance(result)["cameras found"]
        assert list(found) == [f"cam_0{c}" for c in (1, 2, 3, 4)]
        assert max(camera["turned"] for camera in found.values()) > 0.5
        assert all(0 < camera["noise"] < 30 and camera["agreement"] == 1.0 for camera in found.values())


@pytest.mark.full
def test_nobody_needs_a_filter(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The smoothed result is the only one, and whatever reads results reads it."""
    small = ["--frames", "0:12:3", "--max-draws", "50", "-o", "out.nc"]
    assert main(["track", *words(data_dir, 1, 2, 3, 4), *small]) == 0
    assert re.search(r"smoother +│ +laplace", "".join(capsys.readouterr()))
    assert sorted(path.name for path in Path().glob("*.nc")) == ["out-laplace.nc"]
    known = provenance(load_result("out-laplace.nc"))
    assert known["errors"] == "lasting" and "filter" not in known
    assert main(["report", "out-laplace.nc", "-q"]) == 0 and Path("out-laplace.html").is_file()
    assert read_trc("out-laplace.trc").positions.shape == (4, 28, 3)


@pytest.mark.parametrize(
    ("cameras", "settings", "wanted", "expected"),
    [
        (2, {}, Wanted(), True),
        (2, {"walk": "learned", "seed": 3, "max_draws": 9}, Wanted(export=False), True),
        (1, {}, Wanted(), False),
        (2, {"filter": "kalman"}, Wanted(), False),
        (2, {"options": {"num_particles": "9"}}, Wanted(), False),
        (2, {"prior": "walk.nc"}, Wanted(), False),
        (2, {"devices": 2}, Wanted(), False),
        (2, {"on_failure": "stop"}, Wanted(), False),
        (2, {"history_mib": 9.0}, Wanted(), False),
        (2, {}, Wanted(smooth="none"), False),
        (2, {}, Wanted(smooth="trajectory"), False),
        (2, {}, Wanted(checkpoint="run"), False),
    ],
)
def test_who_asks_for_a_filter(cameras: int, settings: dict[str, Any], wanted: Wanted, expected: bool) -> None:
    source = KeypointSettings({f"cam{number}": "pose" for number in range(cameras)}, "rig.toml")
    assert goes_straight(source, TrackSettings(**settings), wanted) is expected
    results = planned(source, TrackSettings(**settings), wanted._replace(output="a.nc")).results
    assert (results == [Path("a-laplace.nc")]) is expected


@pytest.mark.full
def test_errors_of_one_camera_do_not_last(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One camera does not tell them from how far away the person is: smoothed so, whole bodies are far off."""
    small = ["--frames", "0:12:3", "--filter", "kalman", "--max-draws", "50", "--set", "export=false", "-o", "out.nc"]
    assert main(["track", *words(data_dir, 1), *small]) == 0
    assert "assumed to be 1.69 ± 0.09 m tall" in capsys.readouterr().err
    best = provenance(load_result("out-assumed-density.nc"))
    assert (best["errors"], best["settings"]["walk"]) == ("independent", "mean-reverting")


@pytest.mark.full
def test_without_export(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("out.nc").touch()
    small = ["--frames", "0:12:3", "--filter", "kalman", "--max-draws", "50", "-o", "out.nc"]
    assert main(["track", *words(data_dir, 1, 2, 3, 4), *small, "--smooth", "none", "--set", "export=false", "-q"]) == 0
    assert [path.name for path in Path().iterdir()] == ["out.nc"]
    assert "out.nc, which is there, is replaced" in capsys.readouterr().err
    assert load_result("out.nc")["posterior"].sizes["frame"] == 4


@pytest.mark.parametrize(
    ("cameras", "wanted", "expected"),
    [
        (2, Wanted(), ["a-laplace.trc", "a-laplace_lower.trc", "a-laplace_upper.trc", "a-laplace.mot", "a-laplace.osim"]),
        (1, Wanted(), [f"a-assumed-density{end}" for end in (".trc", "_lower.trc", "_upper.trc", ".mot", ".osim")]),
        (2, Wanted(smooth="none"), ["a.trc", "a_lower.trc", "a_upper.trc", "a.mot", "a.osim"]),
        (2, Wanted(export=False), []),
    ],
)
def test_where_exports_go(cameras: int, wanted: Wanted, expected: list[str]) -> None:
    source = KeypointSettings({f"cam{number}": "pose" for number in range(cameras)}, "rig.toml")
    plan = planned(source, TrackSettings(), wanted._replace(output="a.nc"))
    assert plan.exported == [Path(name) for name in expected]


def test_people_of_a_recording_have_files_of_their_own() -> None:
    assert [stem_of("pose/cam1", person) for person in (None, 1, 2)] == ["poseppl-cam1"] * 2 + ["poseppl-cam1-person2"]


@pytest.mark.slow
def test_all_frames_of_four_cameras_are_smoothed(data_dir: Path) -> None:
    """On two cores this waited for ever: a process of its own, with the threads that the command asks for."""
    environment = {name: value for name, value in os.environ.items() if name != "NPROC"}
    script = "import sys; from poseppl.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", script, "track", *words(data_dir, 1, 2, 3, 4), "-q", "-o", "out.nc"]
    subprocess.run(command, check=True, timeout=PATIENCE, env=environment)
    assert read_trc("out-laplace.trc").positions.shape == (100, 28, 3)


@pytest.mark.full
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (["--camera", "x.toml"], "--camera: 'x.toml' (expected CAMERA:NAME=VALUE"),
        (["--skeleton", "x.toml"], "--skeleton is an option of poseppl track recording and points"),
        (["pose"], "CAMERA=FILE"),
        (["--person", "9"], "people are seen by two cameras"),
        (["--layout", "body26"], "coco17"),
        (["--detector", "mine"], "openpose, alphapose, mmpose"),
        (["--camera", "cam_09:offset=3"], "no keypoints of a camera 'cam_09'"),
        (["--camera", "cam_04:offset=soon"], "'soon' is not a number"),
        (["--camera", "cam_04:rate=0"], "0.001 to 100000 frames a second"),
        (["--unit", "feet"], "mm, cm, dm, m, in, or a number of mm"),
        (["--camera", "cam_09:size=960x540"], "no camera 'cam_09' in the calibration"),
        (["--camera", "cam_04:size=half"], "such as cam2:size=960x540"),
        (["--camera", "cam_04:size=0x540"], "such as cam2:size=960x540"),
        (["--camera", "cam_01:size=544x960", "--camera", "cam_04:size=544x960"], "--camera cam_01:size=1088x1920"),
    ],
)
def test_what_does_not_fit_is_reported(
    data_dir: Path, capsys: pytest.CaptureFixture[str], change: list[str], expected: str
) -> None:
    assert main(["track", *words(data_dir, 1, 2), *change, "-o", "out.nc"]) in (1, 2)
    assert expected in capsys.readouterr().err
    assert not Path("out.nc").exists()


def test_the_calibration_that_the_options_give(tmp_path: Path) -> None:
    camera = CameraRecord("a", np.diag([900.0, 900.0, 1.0]), np.zeros(5), np.eye(3), np.array([1.0, 2.0, 3.0]), (1920, 1080))
    write_cameras(tmp_path / "rig.toml", [camera, camera._replace(name="b")])
    files = {"a": "pose/a", "b": "pose/b"}
    found = calibration_of(KeypointSettings(files, tmp_path / "rig.toml", up="y", camera=("b:size=960x540",)))
    assert found.up == "y" and [record.size for record in found.cameras] == [(1920, 1080), (960, 540)]
    np.testing.assert_allclose([record.matrix[0, 0] for record in found.cameras], [900, 450])
    np.testing.assert_allclose(found.cameras[0].rotation @ [1, -3, 2], [1, 2, 3])  # (x, -z, y) of the world is (1, 2, 3)


def test_python_tracks_as_the_command_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keypoints of several cameras are smoothed without a filter, unless one is asked for."""
    source = KeypointSettings({"a": "pose", "b": "pose"}, "rig.toml")
    monkeypatch.setattr("poseppl.motion.sources.scene_of", lambda *_, **__: "scene")
    monkeypatch.setattr("poseppl.motion.sources.smooth_recording", lambda *_: "smoothed")
    monkeypatch.setattr("poseppl.motion.sources.track_scene", lambda *_, **__: "filtered")
    assert track(source) == "smoothed"
    assert track(source, TrackSettings(filter="kalman")) == track(source, checkpoint="run") == "filtered"
    assert track(KeypointSettings({"a": "pose"}, "rig.toml")) == "filtered"
