"""Keypoints that contradict their pictures' size, their rate, their frame numbers or their confidence: a person who walks."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import with_size
from poseppl.motion.io.keypoint_layouts import LAYOUTS
from poseppl.motion.keypoints.sources import Clocks, check_confidences, read_sources
from poseppl.motion.keypoints.suspected_inputs import check_inputs
from poseppl.motion.tracking.placing import cameras_of_records, place_cameras, records_of_cameras

NAMES = LAYOUTS["coco17"]
RATE, FRAMES = 60.0, 60
SIZE = (1200, 1000)
PERSON = np.random.default_rng(0).uniform([-250, -150, 0], [250, 150, 1700], (17, 3))


def places(frames: Floats) -> Floats:
    """Positions of a person who walks to and fro, in frames of the recording."""
    moved = np.stack([600 * np.sin(frames / 12), 25 * frames, 40 * np.cos(frames / 5)], -1)
    return PERSON + moved[:, None]


@pytest.fixture(scope="module")
def records() -> list[CameraRecord]:
    placed = place_cameras(places(np.arange(FRAMES))[:, 0], 0.0, count=3)
    return list(records_of_cameras(placed, 900.0, SIZE))


@pytest.fixture(scope="module")
def cameras(records: list[CameraRecord]) -> Cameras:
    return cameras_of_records(records)


def seen(cameras: Cameras, camera: int, when: Floats | None = None) -> DetectedPeople:
    """Detections of one camera, with 2 px of noise, at these frames of the recording in its own frames 0, 1, ..."""
    frames = np.arange(FRAMES, dtype=float) if when is None else when
    points = np.asarray(project(cameras, jnp.asarray(places(frames)))[camera])
    points = points + np.random.default_rng(camera).normal(0, 2, points.shape)
    return DetectedPeople(points[:, None], np.ones((len(frames), 1, 17)), np.arange(len(frames)), "coco17", NAMES)


def scaled(found: DetectedPeople, scale: float) -> DetectedPeople:
    return found._replace(points=found.points * scale)


def test_nothing_is_suspected_of_what_goes_together(records: list[CameraRecord], cameras: Cameras) -> None:
    people = [seen(cameras, c) for c in range(3)]
    check_inputs(records, people, Clocks(RATE))
    ended = people[1]._replace(points=people[1].points[:30], confidence=people[1].confidence[:30], frames=np.arange(30))
    check_inputs(records, [people[0], ended, people[2]], Clocks(RATE))  # half as many frames of the same rate
    late = [people[0], people[1]._replace(frames=np.arange(FRAMES) + 7), people[2]]
    check_inputs(records, late, Clocks(RATE))
    far = [record._replace(matrix=np.diag([0.4, 0.4, 1.0]) @ record.matrix) for record in records]
    corner = [seen(cameras_of_records(far), c) for c in range(3)]  # the person is small in a corner, as calibrated
    check_inputs(far, corner, Clocks(RATE))
    check_inputs(records[:1], people[:1], Clocks(RATE))


@pytest.mark.parametrize("scale", [0.5, 2 / 3])
def test_the_size_of_pictures(records: list[CameraRecord], cameras: Cameras, scale: float) -> None:
    people = [seen(cameras, c) for c in range(3)]
    small = [scaled(people[0], scale), people[1], scaled(people[2], scale)]
    width, height = (round(side * scale) for side in SIZE)
    options = f"camera='camera_1:size={width}x{height}' camera='camera_3:size={width}x{height}'"
    with pytest.raises(InputError, match=rf"calibration: .*camera_1, camera_3 are .*1200x1000 px, .* {options}"):
        check_inputs(records, small, Clocks(RATE))
    resized = [with_size(records[c], (width, height)) if c != 1 else records[c] for c in range(3)]
    check_inputs(resized, small, Clocks(RATE))


def test_a_resized_picture_has_its_pixels_where_they_were() -> None:
    """The middle of the first pixel is at 0, its corner at -0.5."""
    camera = CameraRecord("a", np.array([[900.0, 0, 600], [0, 900, 500], [0, 0, 1]]), np.zeros(5), np.eye(3), np.zeros(3), SIZE)
    half = with_size(camera, (600, 250))
    ray = np.array([0.3, -0.2, 1.0])
    before, after = (found.matrix @ ray for found in (camera, half))
    np.testing.assert_allclose((after[:2] + 0.5) / (before[:2] + 0.5), [0.5, 0.25])
    assert half.size == (600, 250)


@pytest.mark.parametrize(("ratio", "rate"), [(0.5, "30"), (5 / 6, "50"), (2.0, "120")])
def test_a_camera_of_another_rate(records: list[CameraRecord], cameras: Cameras, ratio: float, rate: str) -> None:
    other = seen(cameras, 1, np.arange(round(FRAMES * ratio)) / ratio)
    people = [seen(cameras, 0), other, seen(cameras, 2)]
    with pytest.raises(
        InputError, match=rf"camera_2 has .* as many frames.*camera='camera_2:rate={rate}'; or camera_2:rate=60 if"
    ):
        check_inputs(records, people, Clocks(RATE))
    for known in (float(rate), RATE):
        check_inputs(records, people, Clocks(RATE, {"camera_2": known}))


def test_frame_numbers_that_never_meet(records: list[CameraRecord], cameras: Cameras) -> None:
    people = []
    for c in range(3):
        found = seen(cameras, c)
        found.points[1 - c % 2 :: 2] = np.nan  # cameras 1 and 3 have even numbers, camera 2 odd ones
        people.append(found)
    with pytest.raises(
        InputError, match=r"camera_2 shares no frame number .* 1, 3, 5, \.\.\. 59.*0, 2, 4, .*camera_2:offset=1"
    ):
        check_inputs(records, people, Clocks(RATE))
    check_inputs(records, people, Clocks(RATE, offsets={"camera_2": 1.0}))


def test_confidences_of_zero_are_named(records: list[CameraRecord], cameras: Cameras) -> None:
    none = seen(cameras, 0)._replace(confidence=np.zeros((FRAMES, 1, 17)))
    with pytest.raises(InputError, match="a: the confidence of all 1020 points .* the largest is 0, .* write 1 for each"):
        check_confidences("a", none)
    known: Mapping[str, CameraRecord] = {record.name: record for record in records}
    with pytest.raises(InputError, match="camera_2: the confidence"):
        read_sources({"camera_1": seen(cameras, 0), "camera_2": none}, known, None, None)
