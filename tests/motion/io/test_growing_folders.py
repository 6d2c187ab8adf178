"""Folders that a detector is writing to: files that come late, in another order, or in parts."""

from __future__ import annotations

import json
import os
import re
import shutil
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE

from poseppl.errors import InputError
from poseppl.motion.io.growing_folders import GrowingFolders, KeypointFrame

NOW = time.monotonic
STEP, WAIT, LATER = 1e4, 1e5, 1e6
"""Seconds from one listing to another, that a camera is waited for, and after which it is not: of a clock that the tests turn.

They are so long that what really passes in a test, which also counts, is nothing to them.
"""


def text(frame: int, camera: int, people: int = 1) -> str:
    """Some people, whose points tell the frame and the camera."""
    points = [float(frame + 1), float(camera + 1), 0.5] * 17
    return json.dumps({"people": [{"pose_keypoints_2d": points}] * people})


def file(folder: Path, camera: int, frame: int) -> Path:
    return folder / f"cam{camera}" / f"cam{camera}_{frame:012d}_keypoints.json"


def write(folder: Path, camera: int, *frames: int) -> None:
    for frame in frames:
        file(folder, camera, frame).write_text(text(frame, camera))


@pytest.fixture
def notes() -> list[str]:
    return []


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, Path]:
    found = {f"cam{camera}": tmp_path / f"cam{camera}" for camera in (0, 1)}
    for folder in found.values():
        folder.mkdir()
    return found


@pytest.fixture
def growing(folders: dict[str, Path], notes: list[str]) -> GrowingFolders:
    return GrowingFolders(folders, wait=WAIT, note=notes.append)


def taken(growing: GrowingFolders, now: float) -> Iterator[tuple[int, list[bool]]]:
    """Frames that can be taken at a time, and which cameras are in them."""
    for seconds in (0.0, STEP):  # two listings
        while (frame := growing.take(now + seconds)) is not None:
            check(frame)
            yield frame.number, [people is not None for people in frame.people]


def check(frame: KeypointFrame) -> None:
    for camera, people in enumerate(frame.people):
        for person in people or []:
            np.testing.assert_array_equal(person[:, :2], np.tile([frame.number + 1, camera + 1], (17, 1)))


def test_frames_go_from_the_first_to_the_last_of_two_cameras(tmp_path: Path, growing: GrowingFolders, notes: list[str]) -> None:
    write(tmp_path, 0, *range(3, 9))
    write(tmp_path, 1, 0, 4, 5, 7, 8, 9)
    assert list(taken(growing, NOW())) == [(3, [True, False]), *((n, [True, n != 6]) for n in range(4, 9))]
    assert [note.partition(",")[0] for note in notes] == ["cam1: it has no file of frame 3", "cam1: it has no file of frame 6"]


def test_a_half_written_file_is_read_again(tmp_path: Path, growing: GrowingFolders, notes: list[str]) -> None:
    whole, now = text(1, 1), NOW()
    write(tmp_path, 0, 0, 1)
    write(tmp_path, 1, 0)
    for part in (0, 1, len(whole) // 2, len(whole) - 1):
        file(tmp_path, 1, 1).write_text(whole[:part])
        assert [number for number, _ in taken(growing, now)] == ([] if part else [0])
    file(tmp_path, 1, 1).write_text(whole)
    assert list(taken(growing, now)) == [(1, [True, True])]
    assert notes == []


def test_a_file_that_stays_damaged_is_named(tmp_path: Path, growing: GrowingFolders, notes: list[str]) -> None:
    write(tmp_path, 0, 0, 1, 2)
    write(tmp_path, 1, 0, 2)
    file(tmp_path, 1, 1).write_text("{")
    now = NOW()
    assert list(taken(growing, now)) == [(0, [True, True])]
    assert list(taken(growing, now + LATER)) == [(1, [True, False]), (2, [True, True])]
    assert len(notes) == 1 and "cam1: it sees nobody in frame 1" in notes[0] and file(tmp_path, 1, 1).name in notes[0]


def test_a_late_camera_is_waited_for_and_reported_once(tmp_path: Path, growing: GrowingFolders, notes: list[str]) -> None:
    write(tmp_path, 0, 0)
    write(tmp_path, 1, 0)
    now = NOW()
    assert [number for number, _ in taken(growing, now)] == [0]
    write(tmp_path, 0, 1, 2, 3)
    assert not list(taken(growing, now + WAIT))  # until another frame of both: one camera alone tells no places
    write(tmp_path, 1, 3)
    assert list(taken(growing, now + LATER)) == [(1, [True, False]), (2, [True, False]), (3, [True, True])]
    assert len(notes) == 1


def test_a_third_camera_that_is_gone_holds_nobody_up(tmp_path: Path) -> None:
    for camera in (0, 1, 2):
        (tmp_path / f"cam{camera}").mkdir()
        write(tmp_path, camera, 0)
    growing = GrowingFolders({f"cam{camera}": tmp_path / f"cam{camera}" for camera in (0, 1, 2)}, wait=WAIT)
    now = NOW()
    assert list(taken(growing, now)) == [(0, [True] * 3)]
    for camera in (0, 1):
        write(tmp_path, camera, 1)
    assert not list(taken(growing, now + 2 * STEP))
    assert list(taken(growing, now + LATER)) == [(1, [True, True, False])]


def test_files_bit_by_bit_in_any_order_of_the_cameras(tmp_path: Path, folders: dict[str, Path], notes: list[str]) -> None:
    frames, seen, stop = 8, [], threading.Event()

    def detect() -> None:
        for frame in range(frames):
            for camera in ((0, 1), (1, 0))[frame % 2]:
                whole = text(frame, camera)
                with file(tmp_path, camera, frame).open("w") as stream:
                    for part in (whole[: 40 * camera], whole[40 * camera :]):
                        stream.write(part)
                        stream.flush()
                        time.sleep(0.01)

    writer = threading.Thread(target=detect)
    writer.start()
    for frame in GrowingFolders(folders, wait=PATIENCE, idle=PATIENCE, note=notes.append).frames(stop):
        check(frame)
        seen.append(frame)
        if len(seen) == frames:
            stop.set()
    writer.join()
    assert [frame.number for frame in seen] == list(range(frames)) and notes == []
    assert all(people is not None and len(people) == 1 for frame in seen for people in frame.people)


def test_one_is_asked_to_stop(tmp_path: Path, growing: GrowingFolders) -> None:
    write(tmp_path, 0, 0, 1, 2)
    write(tmp_path, 1, 0, 1, 2)
    stop, seen = threading.Event(), []
    for frame in growing.frames(stop):
        seen.append(frame.number)
        stop.set()
    assert seen == [0]


def test_what_cannot_be_followed_is_reported(tmp_path: Path, growing: GrowingFolders) -> None:
    (tmp_path / "points.csv").write_text("scorer")
    for name, problem in (("points.csv", "a file"), ("nothing", "no such folder")):
        with pytest.raises(InputError, match=f"{name}.*{problem}.*one JSON file a frame"):
            GrowingFolders({"cam0": tmp_path / name})
    (tmp_path / "cam0" / "last.json").write_text("{}")
    with pytest.raises(InputError, match="has no frame number"):
        growing.take(NOW())


def test_mmpose_writes_lists(tmp_path: Path, growing: GrowingFolders) -> None:
    person = {"keypoints": [[1.0, 1.0]] * 17, "keypoint_scores": [0.5] * 17}
    write(tmp_path, 1, 0)
    (tmp_path / "cam0" / "000000.json").write_text(json.dumps([person]))
    frame = growing.take(NOW())
    assert frame is not None
    check(frame)
    assert [len(people or []) for people in frame.people] == [1, 1]


def test_what_was_taken_is_forgotten_and_many_files_cost_no_listing(
    tmp_path: Path, growing: GrowingFolders, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed, frames, now = [], 3000, NOW()
    scandir = os.scandir
    monkeypatch.setattr("os.scandir", lambda path: listed.append(path) or scandir(path))
    for frame in range(frames):
        write(tmp_path, 0, frame)
        write(tmp_path, 1, frame)
        found = growing.take(now := now + 1 / 60)
        assert found is not None and found.number == frame
        assert growing.take(now) is None
    assert len(listed) == 2
    assert all(len(folder.files) + len(folder.people) == 0 for folder in growing._folders)


def test_files_named_otherwise_are_found_by_listings(tmp_path: Path, growing: GrowingFolders) -> None:
    now = NOW()
    write(tmp_path, 0, *range(6))
    write(tmp_path, 1, 0, 1, 2)
    assert [number for number, _ in taken(growing, now)] == [0, 1, 2]
    for frame in (3, 4, 5):
        (tmp_path / "cam1" / f"after_{frame}.json").write_text(text(frame, 1))
    assert [number for number, _ in taken(growing, now + 2 * STEP)] == [3, 4, 5]


@pytest.mark.parametrize(("gone", "expected"), [(True, "cam1: .*cam1 is gone"), (False, "cam1: no file from frame 1 on")])
def test_why_no_more_frames_come_is_reported(
    tmp_path: Path, folders: dict[str, Path], notes: list[str], gone: bool, expected: str
) -> None:
    write(tmp_path, 0, 0, 1)
    write(tmp_path, 1, 0)
    growing = GrowingFolders(folders, wait=WAIT, idle=0.3, note=notes.append)
    for frame in growing.frames(threading.Event()):
        assert frame.number == 0
        if gone:
            shutil.rmtree(tmp_path / "cam1")
    assert len(notes) == 1 and re.match(expected, notes[0])
