"""The unit of a calibration, from a real person and rigs in metres, centimetres, millimetres and in an unknown unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.io import CameraRecord, DetectedPeople, read_cameras
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.io.keypoint_layouts import LAYOUTS, markers_of_names
from poseppl.motion.keypoints.calibration_units import infer_unit

MARKERS = markers_of_names(LAYOUTS["body25b"])


@pytest.fixture(scope="module")
def records(data_dir: Path) -> tuple[CameraRecord, ...]:
    return read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")


@pytest.fixture(scope="module")
def people(data_dir: Path) -> list[DetectedPeople]:
    return [read_openpose(data_dir / "pose2sim_two_people" / f"cam0{c}_json") for c in (1, 2, 3, 4)]


def as_if(records: tuple[CameraRecord, ...], factor: float) -> list[CameraRecord]:
    """A file whose numbers are so many times as large, its unit still taken for metres."""
    return [record._replace(translation=record.translation * factor) for record in records]


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 100.0), ("mm", 1000.0)])
def test_the_unit_is_found(records: tuple[CameraRecord, ...], people: list[DetectedPeople], unit: str, factor: float) -> None:
    for cameras in ([0, 1, 2, 3], [1, 3]):
        seen = [people[c] for c in cameras]
        found, told = infer_unit([as_if(records, factor)[c] for c in cameras], seen, MARKERS)
        assert told.name == unit and 1.4 < told.stature < 2.1
        for ours, c in zip(found, cameras, strict=True):
            np.testing.assert_allclose(ours.translation, records[c].translation)


@pytest.mark.full
def test_what_makes_no_person_is_reported(records: tuple[CameraRecord, ...], people: list[DetectedPeople]) -> None:
    with pytest.raises(
        InputError, match=r"unit: .* in cm the person would be 0\.5\d m tall .expected mm, cm, m, or how many mm"
    ):
        infer_unit(as_if(records, 1 / 0.0304), people, MARKERS)
    nobody = [found._replace(points=np.full_like(found.points, np.nan)) for found in people]
    with pytest.raises(InputError, match="two cameras see too little of a person to estimate it"):
        infer_unit(list(records), nobody, MARKERS)
