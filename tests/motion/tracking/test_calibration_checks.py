"""What a person tells of a calibration: a wrong unit, and a world whose Z is not up."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from poseppl_models.choo_fleet import full_body

from poseppl.motion.geometry import marker_positions
from poseppl.motion.io import read_cameras
from poseppl.motion.tracking.calibration_checks import calibration_notes
from poseppl.motion.tracking.keypoints import scene_of_keypoints

BODY = full_body()
MARKERS = BODY.tree.marker_names
STANDING = np.stack([np.asarray(marker_positions(BODY.tree, BODY.rest), np.float64)] * 3)


@pytest.mark.parametrize("size", [0.55, 1.0, 1.9])
def test_nothing_is_said_of_a_person_who_stands_or_bends(size: float) -> None:
    bent = np.deg2rad(50)
    forward = np.array([[1, 0, 0], [0, np.cos(bent), np.sin(bent)], [0, -np.sin(bent), np.cos(bent)]])
    assert calibration_notes(size * STANDING, MARKERS) == calibration_notes(size * STANDING @ forward.T, MARKERS) == []
    assert calibration_notes(np.full_like(STANDING, np.nan), MARKERS) == []
    assert calibration_notes(STANDING[:, :2], MARKERS[:2]) == []


@pytest.mark.parametrize(("factor", "height"), [(1000.0, "1.7e+03 m"), (10.0, "17 m"), (0.1, "0.17 m"), (0.4, "0.68 m")])
def test_a_wrong_unit_is_told(factor: float, height: str) -> None:
    (told,) = calibration_notes(factor * STANDING, MARKERS)
    assert f"about {height} tall" in told and "--unit" in told


@pytest.mark.full
@pytest.mark.parametrize(("axis", "sign", "name"), [(1, -1, "-y"), (1, 1, "+y"), (0, 1, "+x"), (2, -1, "-z")])
def test_a_world_that_lies_on_its_side_is_told(axis: int, sign: int, name: str) -> None:
    places = np.roll(STANDING, axis - 2, axis=-1) * sign
    (told,) = calibration_notes(places, MARKERS)
    assert f"trunk points along {name} of the calibration" in told


@pytest.mark.full
def test_a_world_of_the_first_cameras_axes_is_told(data_dir: Path) -> None:
    """As anipose has it: its y points down in the room."""
    folder = data_dir / "pose2sim_balancing"
    records = read_cameras(folder / "calibration" / "Calib_qualisys.toml")
    first, others = records[0], []
    for record in records:
        turn = record.rotation @ first.rotation.T
        others.append(record._replace(rotation=turn, translation=record.translation - turn @ first.translation))
    files = {f"cam_0{c}": folder / "pose" / f"cam0{c}_json" for c in (1, 4)}
    for cameras, count in ((records, 0), (others, 1)):
        found = scene_of_keypoints(files, cameras, frames="0:8", rate=60.0, refine=False, mend=False)
        assert sum("trunk points along -y" in note for note in found.notes()) == count
