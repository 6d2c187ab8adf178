"""Clocks of a real recording of four synchronised cameras: shifted, of other rates, cut off, and as they are."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras
from poseppl.motion.io import DetectedPeople, read_cameras
from poseppl.motion.io.detections import without_strays
from poseppl.motion.io.json_detectors import read_openpose
from poseppl.motion.keypoints.clock_offsets import SYSTEMATIC, synchronize
from poseppl.motion.keypoints.clocks import Clock, align, resampled
from poseppl.motion.keypoints.people import associate_person
from poseppl.motion.keypoints.sources import (
    Clocks,
    common_frames,
    find_offsets,
    points_of,
    read_sources,
)
from poseppl.motion.tracking.placing import cameras_of_records

NAMES = ("cam_01", "cam_02", "cam_03", "cam_04")


@pytest.fixture(scope="module")
def cameras(data_dir: Path) -> Cameras:
    return cameras_of_records(read_cameras(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml"))


@pytest.fixture(scope="module")
def people(data_dir: Path) -> list[DetectedPeople]:
    return [read_openpose(data_dir / "pose2sim_balancing" / "pose" / f"cam0{c}_json") for c in (1, 2, 3, 4)]


def late(people: list[DetectedPeople], *frames: float) -> list[DetectedPeople]:
    """The same, each camera so many frames late."""
    moved = []
    for found, shift in zip(people, frames, strict=True):
        whole = int(np.floor(shift))
        part = shift - whole
        positions = np.arange(len(found.frames) - (part > 0)) + (1 - part if part else 0.0)
        between = resampled(found, positions, np.arange(len(positions)))
        moved.append(between._replace(frames=np.arange(len(positions)) + whole + (part > 0)))
    return moved


@pytest.mark.parametrize(("camera", "shift"), [(1, 1.0), (1, 4.5), (2, 2.0), (2, 10.0), (3, 7.0), (3, -10.0)])
@pytest.mark.slow
def test_an_offset_is_recovered(cameras: Cameras, people: list[DetectedPeople], camera: int, shift: float) -> None:
    """Within 0.2 frame and two standard deviations; the cameras that are not late are left alone."""
    moved = late(people, *(shift if c == camera else 0.0 for c in range(4)))
    found = find_offsets(cameras, moved, [Clock()] * 4, 60.0)
    assert found is not None
    off = found.frames - np.where(np.arange(4) == camera, shift, 0.0)
    assert np.abs(off).max() < 0.2
    assert np.all(np.abs(off) < 2 * found.deviation + 1e-9) and np.all(found.deviation < 0.2)


@pytest.mark.full
def test_an_offset_is_reported_and_corrected(cameras: Cameras, people: list[DetectedPeople]) -> None:
    aligned, notes = common_frames(NAMES, cameras, late(people, 0, 0, 6.0, 0), Clocks(60.0), None)
    assert [note.split(":")[0] for note in notes if "its clock is" in note] == ["cam_03"]
    told = re.search(r"its clock is \+([\d.]+) frames from that of cam_01 \(90 % interval \+([\d.]+) to \+([\d.]+)\)", notes[0])
    assert told is not None
    offset, low, high = map(float, told.groups())
    assert abs(offset - 6) < 0.25 and low <= 6 <= high and high - low < 0.8
    chosen = [associate_person(cameras, found, 60.0)[:90, 2] for found in (aligned.people, people)]
    assert (chosen[0] == chosen[1]).mean() > 0.95


@pytest.mark.full
def test_the_cameras_as_they_are_have_no_offset(cameras: Cameras, people: list[DetectedPeople]) -> None:
    aligned, notes = common_frames(NAMES, cameras, people, Clocks(60.0), None)
    assert notes == [] and aligned.frames.tolist() == list(range(100))
    for found, read in zip(aligned.people, people, strict=True):
        np.testing.assert_array_equal(found.points, read.points)


@pytest.mark.parametrize("camera", range(4))
def test_a_camera_that_ends_early_has_no_offset(cameras: Cameras, people: list[DetectedPeople], camera: int) -> None:
    """In 40 frames errors of the calibration move the clock of one of these cameras by a frame."""
    cut = list(people)
    cut[camera] = cut[camera]._replace(**{name: getattr(cut[camera], name)[:40] for name in ("points", "confidence", "frames")})
    _, notes = common_frames(NAMES, cameras, cut, Clocks(60.0), None)
    assert [note.split(":")[1][:20] for note in notes] == [" it ends at frame 39"]


def test_points_anywhere_in_the_picture_make_no_offset(cameras: Cameras, people: list[DetectedPeople]) -> None:
    """A point in twenty."""
    rng = np.random.default_rng(0)
    strewn = []
    for found in people:
        astray = rng.random(found.points.shape[:-1]) < 0.05
        anywhere = rng.uniform(0.0, [1088.0, 1920.0], found.points.shape)
        strewn.append(found._replace(points=np.where(astray[..., None] & np.isfinite(found.points), anywhere, found.points)))
    found = find_offsets(cameras, strewn, [Clock()] * 4, 60.0)
    assert found is not None
    assert np.abs(found.frames).max() < 0.5


def test_a_given_offset_is_taken(cameras: Cameras, people: list[DetectedPeople]) -> None:
    moved = late(people, 0, 0, 5, 0)
    aligned, _ = common_frames(NAMES, cameras, moved, Clocks(60.0, offsets={"cam_03": 5.0}, find=False), None)
    np.testing.assert_array_equal(aligned.people[2].points, people[2].points)
    with pytest.raises(InputError, match=r"camera: no keypoints of a camera 'left' .expected cam_01"):
        common_frames(NAMES, cameras, moved, Clocks(60.0, offsets={"left": 5.0}), None)


@pytest.mark.full
def test_cameras_of_different_rates(cameras: Cameras, people: list[DetectedPeople]) -> None:
    """Every second frame of one camera: between them its points are within 3 px of what it saw, in the median."""
    half = people[1]
    half = half._replace(points=half.points[::2], confidence=half.confidence[::2], frames=np.arange(50))
    mixed = [people[0], half, people[2], people[3]]
    aligned, _ = common_frames(NAMES, cameras, mixed, Clocks(60.0, rates={"cam_02": 30.0}), None)
    chosen = [points_of(found, associate_person(cameras, found, 60.0))[0][:, 1] for found in (aligned.people, people)]
    assert aligned.frames.tolist() == list(range(100))
    np.testing.assert_array_equal(chosen[0][::2], chosen[1][::2])
    off = np.linalg.norm(chosen[0][1:98:2] - chosen[1][1:98:2], axis=-1)
    assert np.nanmedian(off) < 3 and np.isfinite(chosen[0][1:98]).all(-1).mean() > 0.8
    assert np.isnan(chosen[0][99]).all()


@pytest.mark.full
def test_times_are_those_of_the_file(cameras: Cameras, people: list[DetectedPeople]) -> None:
    """Cameras that started at different times and tell so; the numbers of their frames say nothing."""
    shifted = []
    for c, found in enumerate(people):
        own = slice(5 * c, 100)
        times = np.arange(100)[own] / 60.0
        numbers = np.arange(len(times)) + 1000 * c
        shifted.append(found._replace(points=found.points[own], confidence=found.confidence[own], frames=numbers, times=times))
    aligned, notes = common_frames(NAMES, cameras, shifted, Clocks(60.0), None)
    assert aligned.frames.tolist() == list(range(5, 100))
    for found, read in zip(aligned.people[2:], people[2:], strict=True):
        np.testing.assert_allclose(found.points[10:], read.points[15:], atol=1e-6)
    assert [note for note in notes if "begins" in note] == [
        "cam_04: it begins at frame 15, the others at 5; before that it sees nobody"
    ]
    with pytest.raises(InputError, match="no times in the files of cam_01"):
        common_frames(NAMES, cameras, [people[0], *shifted[1:]], Clocks(60.0), None)


@pytest.mark.parametrize("offset", [-6.0, 6.0])
def test_a_camera_sees_nobody_outside_of_its_times(people: list[DetectedPeople], offset: float) -> None:
    timed = people[0]._replace(times=np.arange(100) / 60.0)
    clock = Clock(offset=offset, times=True, rate=60.0)
    seen = np.isfinite(resampled(timed, clock.positions(timed, np.arange(-50, 150)), np.arange(-50, 150)).points)
    assert not seen[[*range(44), *range(156, 200)]].any() and seen[60:140].any((1, 2, 3)).all()


def test_times_of_a_clock_count_from_its_first_second(cameras: Cameras, people: list[DetectedPeople]) -> None:
    """Seconds since 1970 would be frame numbers of eleven digits, of which other programs keep nine."""
    timed = [found._replace(times=1.7e9 + 0.5 + np.arange(100) / 60.0) for found in people]
    aligned, _ = common_frames(NAMES, cameras, timed, Clocks(60.0, find=False), None)
    assert aligned.frames.tolist() == list(range(30, 130))
    for found, read in zip(aligned.people, people, strict=True):
        np.testing.assert_allclose(found.points[10:90], read.points[10:90], atol=1e-3)


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_times_that_are_no_seconds_are_refused(cameras: Cameras, people: list[DetectedPeople], factor: float) -> None:
    timed = [found._replace(times=factor * np.arange(100) / 60.0) for found in people]
    with pytest.raises(InputError, match=r"rate: the frames of cam_01 are .* s apart by their times"):
        common_frames(NAMES, cameras, timed, Clocks(60.0, find=False), None)


def test_confidences_in_percent_are_reported(data_dir: Path, people: list[DetectedPeople]) -> None:
    known = {record.name: record for record in read_cameras(data_dir / "pose2sim_balancing/calibration/Calib_qualisys.toml")}
    for factor, count in ((1.0, 0), (100.0, 4)):
        seen = [found._replace(confidence=factor * found.confidence) for found in people]
        _, notes = read_sources(dict(zip(NAMES, seen, strict=True)), known, None, None)
        assert sum("most confidences are above 1" in note for note in notes) == count


def test_a_file_that_ends_early_takes_nothing_from_the_others(cameras: Cameras, people: list[DetectedPeople]) -> None:
    short = people[2]._replace(points=people[2].points[:40], confidence=people[2].confidence[:40], frames=people[2].frames[:40])
    aligned, notes = common_frames(NAMES, cameras, [*people[:2], short, people[3]], Clocks(60.0, find=False), None)
    assert aligned.frames.tolist() == list(range(100)) and np.isnan(aligned.people[2].points[40:]).all()
    assert notes == ["cam_03: it ends at frame 39, the others at 99; after that it sees nobody"]
    with pytest.raises(InputError, match="no common frame: 0 to 99, 200 to 299"):
        align([people[0], people[1]._replace(frames=people[1].frames + 200)], [Clock(), Clock()])


@pytest.mark.full
def test_what_is_far_outside_is_named_and_not_seen(people: list[DetectedPeople]) -> None:
    points = people[0].points.copy()
    t, p, k = np.argwhere(np.isfinite(points).all(-1))[50]
    points[t, p, k] = [1e9, 400.0]
    found, notes = without_strays(people[0]._replace(points=points), (1088, 1920), "cam_01")
    assert np.isnan(found.points[t, p, k]).all() and found.confidence[t, p, k] == 0
    assert np.isfinite(found.points).sum() == np.isfinite(points).sum() - 2
    assert notes == [
        f"cam_01: 1 points lie far outside of its picture of 1088 x 1920 px and count as not seen, the first in frame {t}, "
        f"{found.names[k]}, at (1e+09, 400)"
    ]
    assert without_strays(people[0], (1088, 1920), "cam_01")[1] == []


@pytest.mark.full
def test_the_interval_holds_errors_of_calibration(cameras: Cameras, people: list[DetectedPeople]) -> None:
    """By pairs of cameras, which are synchronised: 6 offsets within three standard deviations, none sure to be half a frame."""
    import jax

    for pair in ([0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]):
        both = jax.tree.map(lambda leaf, pair=pair: leaf[np.array(pair)], cameras)
        seen = [people[c] for c in pair]
        points, confidence = points_of(seen, associate_person(both, seen, 60.0))
        found = synchronize(both, points, confidence, 60.0)
        assert found is not None
        assert abs(found.frames[1]) < 3 * found.deviation[1] and found.deviation[1] >= SYSTEMATIC * 60.0


def test_between_two_frames_points_are_a_part_of_the_way_and_no_surer_than_either() -> None:
    """One person of three points, the last of which is seen in the first frame alone, listed second in the frame after."""
    person = np.array([[0.0, 0.0], [100.0, 0.0], [50.0, 80.0]])
    moved = person + [8.0, 4.0]
    moved[2] = np.nan
    other = person + 1000.0
    found = DetectedPeople(
        np.array([[person, other], [other, moved]]),
        np.array([[[0.9, 0.2, 0.7], [0.5, 0.5, 0.5]], [[0.6, 0.6, 0.6], [0.3, 0.8, 0.0]]]),
        np.array([0, 1]),
        "",
        ("a", "b", "c"),
    )
    between = resampled(found, np.array([0.25, 0.75]), np.array([10, 11]))
    assert between.frames.tolist() == [10, 11]
    np.testing.assert_allclose(between.points[0, 0], [[2.0, 1.0], [102.0, 1.0], [50.0, 80.0]])
    np.testing.assert_allclose(between.confidence[0, 0], [0.3, 0.2, 0.7])
    np.testing.assert_allclose(between.points[1, 0], [[6.0, 3.0], [106.0, 3.0], [np.nan, np.nan]])
    np.testing.assert_allclose(between.confidence[1, 0], [0.3, 0.2, 0.0])
    np.testing.assert_allclose(between.points[:, 1], [other, other])
    np.testing.assert_allclose(between.confidence[:, 1], 0.5)
