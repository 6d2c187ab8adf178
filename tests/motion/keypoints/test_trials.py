"""Trials are found by the names of their cameras, each with the nearest calibration; what is none is listed with the reason."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord, write_cameras
from poseppl.motion.keypoints.trials import find_trials, match_cameras

CAMERA = CameraRecord("cam_01", np.diag([900.0, 900.0, 1.0]), np.zeros(5), np.eye(3), np.array([0.0, 0.0, 3.0]), (1920, 1080))


def calibration(path: Path, *names: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_cameras(path, [CAMERA._replace(name=name) for name in names])


def touched(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("{}")


def test_a_study_of_several_layouts(tmp_path: Path) -> None:
    calibration(tmp_path / "calibration" / "rig.toml", "cam_01", "cam_02", "cam_03")
    calibration(tmp_path / "other" / "my_Calib.toml", "left", "right")
    touched(tmp_path / "s1" / "walk1", "cam1.json", "cam2.json", "cam3.json", "notes.json")
    touched(tmp_path / "s1" / "walk2" / "pose", "cam01_json/f_1.json", "CAM-03_json/f_1.json")
    touched(tmp_path / "s2" / "run", "cam_02DLC_resnet50.csv", "cam_10.csv")
    touched(tmp_path / "s2" / "twice", "cam1.json", "cam_01.csv", "cam2.json")
    touched(tmp_path / "other" / "hop", "right.json", "left.json")
    touched(tmp_path / "papers", "table.csv")
    found = find_trials(tmp_path)
    trials = {trial.name: trial for trial in found.trials}
    assert list(trials) == ["other/hop", "s1/walk1", "s1/walk2", "s2/run", "s2/twice"]
    assert {camera: path.name for camera, path in trials["s1/walk1"].files.items()} == {
        f"cam_0{number}": f"cam{number}.json" for number in (1, 2, 3)
    }
    assert list(trials["s1/walk2"].files) == ["cam_01", "cam_03"] and trials["s1/walk2"].absent == ("cam_02",)
    assert trials["s1/walk2"].files["cam_01"] == tmp_path / "s1" / "walk2" / "pose" / "cam01_json"
    assert list(trials["other/hop"].files) == ["left", "right"]
    assert trials["other/hop"].calibration.name == "my_Calib.toml" and trials["s1/walk1"].calibration.name == "rig.toml"
    assert "one camera alone, cam_02" in trials["s2/run"].problem
    assert trials["s2/twice"].problem == "cam1.json, cam_01.csv are all of the camera cam_01"
    assert not any(trials[name].problem for name in ("s1/walk1", "s1/walk2", "other/hop"))
    ((where, why),) = found.passed_over
    assert where.name == "papers" and why == "no file is named as a camera of rig.toml (cam_01, cam_02, cam_03): table"


def test_one_trial_and_one_calibration_for_all(tmp_path: Path) -> None:
    calibration(tmp_path / "rig.toml", "a", "b")
    calibration(tmp_path / "trial" / "calib.toml", "c", "d")
    touched(tmp_path / "trial", "a.json", "b.json")
    (trial,) = find_trials(tmp_path / "trial", tmp_path / "rig.toml").trials
    assert (trial.name, list(trial.files), trial.calibration) == ("trial", ["a", "b"], tmp_path / "rig.toml")


def test_what_cannot_be_chosen_is_said(tmp_path: Path) -> None:
    touched(tmp_path / "trial", "a.json", "b.json")
    with pytest.raises(InputError, match=r"there is no trial in it .*no calibration in it or around it"):
        find_trials(tmp_path)
    calibration(tmp_path / "calib1.toml", "a", "b")
    calibration(tmp_path / "calib2.toml", "a", "b")
    with pytest.raises(InputError, match=r"calib1.toml, calib2.toml are calibrations .*calibration"):
        find_trials(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        find_trials(tmp_path / "none")


@pytest.mark.parametrize(
    ("name", "camera"),
    [
        ("cam1", "cam_01"),
        ("cam_10", "cam_10"),
        ("Cam-01_keypoints", "cam_01"),
        ("cam100", None),
        ("cam", None),
        ("cam_1x", None),
    ],
)
def test_names_of_cameras(name: str, camera: str | None) -> None:
    assert match_cameras([name], ("cam_01", "cam_10")) == [camera]


def test_names_that_are_alike_are_not_guessed() -> None:
    assert match_cameras(["cam1", "cam_01", "Cam1"], ("cam1", "cam_01")) == ["cam1", "cam_01", None]
