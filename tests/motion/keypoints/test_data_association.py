"""Exchanged limbs and other people's detections, put into real recordings: found and put right, and nothing else touched."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseppl.motion.bodies.body import body_builder
from poseppl.motion.io import CameraRecord, read_cameras
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.io.keypoint_layouts import LAYOUTS
from poseppl.motion.keypoints.data_association import associate
from poseppl.motion.keypoints.people import associate_person
from poseppl.motion.keypoints.scene import scene_of_keypoints, with_markers
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import cameras_of_records

CAMERAS = (2, 4)
"""Those that see the person at the narrowest angle."""


@pytest.fixture
def records(data_dir: Path) -> tuple[CameraRecord, ...]:
    found = read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")
    return tuple(found[c - 1] for c in CAMERAS)


@pytest.mark.full
def test_limbs_exchanged_in_a_tenth_of_the_frames_are_put_right(
    tmp_path: Path, data_dir: Path, records: tuple[CameraRecord, ...]
) -> None:
    """Ten frames of a hundred for each pair, each in one of two cameras: all are found, and nothing else."""
    numbers = {name: number for number, name in enumerate(LAYOUTS["body25b"])}
    feet = ("heel", "big_toe", "small_toe")
    limbs = {"arms": ("shoulder", "elbow", "wrist"), "legs": ("hip", "knee", "ankle", *feet)}
    rng = np.random.default_rng(0)
    wrong = np.zeros((100, 2, 2), bool)
    for pair in range(2):
        wrong[rng.choice(100, 10, replace=False), rng.integers(2, size=10), pair] = True
    for c, camera in enumerate(CAMERAS):
        (tmp_path / f"cam0{camera}").mkdir()
        for file in sorted((data_dir / "pose2sim_balancing" / "pose" / f"cam0{camera}_json").glob("*.json")):
            told = json.loads(file.read_text())
            of = np.arange(len(numbers))
            for pair, parts in enumerate(limbs.values()):
                if wrong[int(file.stem.split(".")[1].split("_")[0]), c, pair]:
                    for part in parts:
                        left, right = numbers[f"{part}_l"], numbers[f"{part}_r"]
                        of[[left, right]] = right, left
            for person in told["people"]:
                person["pose_keypoints_2d"] = np.reshape(person["pose_keypoints_2d"], (-1, 3))[of].ravel().tolist()
            (tmp_path / f"cam0{camera}" / file.name).write_text(json.dumps(told))
    exchanged = {f"cam_0{c}": tmp_path / f"cam0{c}" for c in CAMERAS}
    true = {f"cam_0{c}": data_dir / "pose2sim_balancing" / "pose" / f"cam0{c}_json" for c in CAMERAS}
    found = scene_of_keypoints(KeypointSettings(exchanged, records, rate=60, keep=("clocks",)))
    associated: Any = found.associated
    assert np.array_equal(associated.swaps > 0.5, wrong)
    assert f"left and right legs are swapped in {wrong[:, 0, 1].sum()} frames" in " ".join(found.notes())
    untouched = scene_of_keypoints(KeypointSettings(true, records, rate=60, keep=("clocks", "calibration", "detections")))
    assert np.array_equal(associated.points, untouched.scene.data.points, equal_nan=True)
    assert found.scene.data.faults["swaps"].shape == (100, 2, 2)
    assert found.scene.first_frames(7).data.faults["wrong_person"].shape == (7, 2)


def test_another_persons_detections_are_recognised(data_dir: Path, records: tuple[CameraRecord, ...]) -> None:
    """In a tenth of the frames a camera has the synthetic person, who is of confidence 1, taken for the real one."""
    people = [read_openpose(data_dir / "pose2sim_two_people" / f"cam0{c}_json") for c in CAMERAS]
    cameras = cameras_of_records(records)
    true = associate_person(cameras, people, 60.0, 2)
    certain = [(found.confidence > 0.999).any(-1) for found in people]
    rng = np.random.default_rng(0)
    chosen, rows = true.copy(), rng.choice(100, 10, replace=False)
    for row, c in zip(rows, rng.integers(2, size=10), strict=True):
        chosen[row, c] = int(np.argmax(certain[c][row]))
    assert np.any(chosen != true)
    bodies = [with_markers(found, body_builder(DEFAULT_MODEL)(None).tree.marker_names) for found in people]
    sizes = np.array([record.size for record in records], float)
    associated: Any = associate(cameras, sizes, bodies, chosen, 60.0)
    assert np.array_equal(associated.chosen, true)
    assert np.nanmin(associated.identity) > 0.99
    kept: Any = associate(cameras, sizes, bodies, true, 60.0)
    assert np.array_equal(kept.chosen, true)


@pytest.mark.full
def test_a_few_frames_tell_nothing(data_dir: Path, records: tuple[CameraRecord, ...]) -> None:
    people = [read_openpose(data_dir / "pose2sim_two_people" / f"cam0{c}_json") for c in CAMERAS]
    few = [found._replace(points=found.points[:5], confidence=found.confidence[:5]) for found in people]
    bodies = [with_markers(found, body_builder(DEFAULT_MODEL)(None).tree.marker_names) for found in few]
    assert associate(cameras_of_records(records), np.ones((2, 2)), bodies, np.zeros((5, 2), int), 60.0) is None
