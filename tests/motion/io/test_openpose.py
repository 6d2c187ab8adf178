"""OpenPose's JSON files: real ones, and ones that are wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names


def person(count: int, eye: float = 10.0) -> dict[str, Any]:
    """Points below each other, 40 px apart; point 15 is so far from the nose."""
    points = np.stack([np.full(count, 100.0), 50.0 + 40 * np.arange(count), np.full(count, 0.5)], 1)
    if count > 15:
        points[15, :2] = points[0, :2] + [0, eye]
    return {"pose_keypoints_2d": points.ravel().tolist()}


def write(folder: Path, *frames: Any, first: int = 0) -> Path:
    for number, people in enumerate(frames, start=first):
        (folder / f"cam_{number:012d}_keypoints.json").write_text(json.dumps({"people": people}))
    return folder


def test_a_recording_is_read(data_dir: Path) -> None:
    found = read_openpose(data_dir / "pose2sim_balancing" / "pose" / "cam01_json")
    published = np.load(data_dir / "pose2sim_balancing" / "reference" / "balancing_keypoints.npz")["kp"][:, 0]
    assert found.layout == "body25b"
    assert found.points.shape[0] == 100
    off = np.linalg.norm(found.points - published[:, None, :, :2], axis=-1)
    assert np.nan_to_num(off, nan=0.0).max(-1).min(1).max() < 0.01
    with_empty_lists = read_openpose(data_dir / "pose2sim_two_people" / "cam01_json")
    assert with_empty_lists.points.shape[1] >= 2


@pytest.mark.parametrize(("count", "layout"), [(17, "coco17"), (18, "coco18"), (26, "halpe26")])
def test_the_number_of_points_tells_the_layout(tmp_path: Path, count: int, layout: str) -> None:
    assert read_openpose(write(tmp_path, [person(count)])).layout == layout
    assert max(markers_of_names(LAYOUTS[layout]).values()) < len(LAYOUTS[layout]) == count


def test_eyes_are_near_the_nose_and_ankles_are_not(tmp_path: Path) -> None:
    assert read_openpose(write(tmp_path, [person(25, eye=20.0)])).layout == "body25"
    assert read_openpose(write(tmp_path, [person(25, eye=700.0)])).layout == "body25b"
    assert read_openpose(tmp_path, "body25").layout == "body25"


def test_what_was_not_found_is_missing(tmp_path: Path) -> None:
    absent, unknown = person(17), person(17)
    absent["pose_keypoints_2d"][3:6] = [0, 0, 0]
    unknown["pose_keypoints_2d"][3:6] = [float("nan"), float("nan"), 1.0]
    write(tmp_path, [absent, unknown], [], first=7)
    write(tmp_path, [{"pose_keypoints_2d": []}, person(17)], first=10)
    found = read_openpose(tmp_path)
    assert found.frames.tolist() == [7, 8, 9, 10]
    assert np.isnan(found.points[0, :2, 1]).all()
    assert (found.confidence[0, :2, 1] == 0).all()
    assert np.isfinite(found.points[0, :2, 2]).all()
    assert np.isnan(found.points[1:3]).all()
    assert np.isfinite(found.points[3, 0]).all()


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("{", "malformed JSON"),
        ("[]", "people: not a list of people"),
        ('{"people": [{"pose_keypoints_2d": [1, 2]}]}', r"people\[0\].pose_keypoints_2d: 2 numbers"),
        ('{"people": [{"pose_keypoints_2d": [1, "2", 3]}]}', "'2' is not a number"),
        ('{"people": [{"pose_keypoints_2d": [1e12, 2, 3]}]}', "too large"),
        ('{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}', r"people with 1 points \(expected coco17 \(17\)"),
        ('{"people": []}', "nobody was found in any of 1 frames"),
    ],
)
def test_what_is_wrong_is_reported(tmp_path: Path, document: str, words: str) -> None:
    (tmp_path / "cam.0000.json").write_text(document)
    with pytest.raises(InputError, match=words):
        read_openpose(tmp_path)


def test_files_and_layouts_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        read_openpose(tmp_path / "absent")
    with pytest.raises(InputError, match="no .json file"):
        read_openpose(tmp_path)
    write(tmp_path, [person(17)], [person(17), person(18)])
    with pytest.raises(InputError, match=r"people with \[17, 18\] points"):
        read_openpose(tmp_path)
    write(tmp_path, [], first=1)
    with pytest.raises(InputError, match="25, as body25 has"):
        read_openpose(tmp_path, "body25")
    with pytest.raises(InputError, match="layout"):
        read_openpose(tmp_path, "mine")
    (tmp_path / "other.1.json").write_text("{}")
    with pytest.raises(InputError, match="frame 1 is also"):
        read_openpose(tmp_path)
    (tmp_path / "notes.json").write_text("{}")
    with pytest.raises(InputError, match="has no frame number"):
        read_openpose(tmp_path)
