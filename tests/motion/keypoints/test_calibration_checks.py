"""Checks of a calibration by a person: a wrong unit, and which axis of its world is up."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, marker_positions, project
from poseppl.motion.io import Calibration, CameraRecord, read_cameras
from poseppl.motion.io.camera_fields import with_z_up
from poseppl.motion.io.motion import z_up
from poseppl.motion.keypoints.calibration_checks import calibration_notes, vertical_of_calibration
from poseppl.motion.keypoints.scene import scene_of_keypoints
from poseppl.motion.keypoints.settings import KeypointSettings
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras

BODY = full_body()
MARKERS = BODY.tree.marker_names
STANDING = np.stack([np.asarray(marker_positions(BODY.tree, BODY.rest), np.float64)] * 3)


@pytest.mark.parametrize("size", [0.55, 1.0, 1.9])
def test_nothing_is_said_of_the_unit_of_a_person_of_usual_size(size: float) -> None:
    assert calibration_notes(size * STANDING, MARKERS) == []
    assert calibration_notes(np.full_like(STANDING, np.nan), MARKERS) == []
    assert calibration_notes(STANDING[:, :2], MARKERS[:2]) == []


@pytest.mark.parametrize(("factor", "height"), [(1000.0, "1.7e+03 m"), (10.0, "17 m"), (0.1, "0.17 m"), (0.4, "0.68 m")])
def test_a_wrong_unit_is_reported(factor: float, height: str) -> None:
    (told,) = calibration_notes(factor * STANDING, MARKERS)
    assert f"about {height} tall" in told and "(unit)" in told


def rig(count: int) -> list[CameraRecord]:
    """Level cameras around a standing person, of whom they see all."""
    placed = place_cameras(STANDING[:, MARKERS.index("pelvis")], 0.0, count=count)
    return list(records_of_cameras(placed, 1000.0, (1000, 1000)))


def seen_by(records: list[CameraRecord], places: Floats) -> tuple[Cameras, Floats, Floats]:
    cameras = cameras_of_records(records)
    points = np.stack([project(cameras, jnp.asarray(frame)) for frame in places])
    return cameras, points, np.ones(points.shape[:3])


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("up", ["z", "-y", "x"])
def test_the_axis_along_which_a_person_stands_is_found(up: str, count: int) -> None:
    turn = z_up(np.eye(3), up).T  # from a world with Z up to one with another axis up
    turned = [record._replace(rotation=record.rotation @ turn) for record in rig(count)]
    cameras, points, confidence = seen_by(turned, STANDING @ turn)
    found = vertical_of_calibration(cameras, points, confidence, MARKERS)
    assert found.axis == up and found.certain
    back = [with_z_up(record, found.axis) for record in turned]
    np.testing.assert_allclose([record.rotation for record in back], [record.rotation for record in rig(count)], atol=1e-12)


def test_a_person_who_lies_does_not_turn_the_world() -> None:
    lying = np.roll(STANDING, 1, axis=-1)
    found = vertical_of_calibration(*seen_by(rig(4), lying), MARKERS)
    assert found.axis == "z" and not found.certain
    assert "above the feet along X" in found.note() and "up sets another axis" in found.note()


@pytest.mark.full
def test_a_world_of_the_first_cameras_axes_is_turned(data_dir: Path) -> None:
    """As anipose has it: its y points down in the room."""
    folder = data_dir / "pose2sim_balancing"
    records = read_cameras(folder / "calibration" / "Calib_qualisys.toml")
    first, others = records[0], []
    for record in records:
        turn = record.rotation @ first.rotation.T
        others.append(record._replace(rotation=turn, translation=record.translation - turn @ first.translation))
    files = {f"cam_0{c}": folder / "pose" / f"cam0{c}_json" for c in (1, 4)}
    for cameras, axis in ((records, "Z"), (others, "-Y")):
        found = scene_of_keypoints(
            KeypointSettings(files, cameras, frames="0:8", rate=60.0, keep=("calibration", "detections"))
        )
        assert sum(f"calibration's {axis} is up" in note for note in found.notes()) == 1
        chosen = scene_of_keypoints(
            KeypointSettings(files, Calibration(tuple(cameras), "mm", axis.lower()), frames="0:8", rate=60.0)
        )
        assert any(f"{axis} of the calibration is up" in note for note in chosen.notes())
