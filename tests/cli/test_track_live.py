"""`poseppl track live` on a real recording, whose files come while it runs."""

from __future__ import annotations

import csv
import os
import re
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from balancing_options import words
from waiting import PATIENCE

from poseppl.cli import main
from poseppl.cli.track_live import LiveTable
from poseppl.motion.io.trc import read_trc
from poseppl.motion.keypoints.live import LiveEstimate
from poseppl.runs.results import load_result

pytestmark = pytest.mark.usefixtures("without_pictures")

FRAMES, CAMERAS = 10, (1, 2, 3, 4)
SMALL = ["--start", "0.08", "--wait", f"{PATIENCE:g}", "--filter", "kalman", "--max-draws", "50", "-q"]


@pytest.fixture(autouse=True)
def _files(here: None) -> None:
    for camera in CAMERAS:
        Path(f"cam0{camera}").mkdir()


@pytest.fixture
def options(data_dir: Path) -> list[str]:
    """Those of the recording, of folders here that are still empty."""
    return [re.sub(r"=.*(cam0\d)_json", r"=\1", word) for word in words(data_dir, *CAMERAS, source="live")]


def files(data_dir: Path, frame: int) -> list[Path]:
    folder = data_dir / "pose2sim_balancing" / "pose"
    return [sorted((folder / f"cam0{camera}_json").glob("*.json"))[frame] for camera in CAMERAS]


def detect(data_dir: Path, ended: threading.Event) -> None:
    """Write the files as a detector does, and interrupt the command once it has reported all."""
    time.sleep(0.1)
    for frame in range(FRAMES):
        order = list(zip(CAMERAS, files(data_dir, frame), strict=True))
        for camera, file in order if frame % 2 else order[::-1]:
            whole = file.read_bytes()
            with Path(f"cam0{camera}", file.name).open("wb") as stream:
                for part in (whole[:1000], whole[1000:]):
                    stream.write(part)
                    stream.flush()
                    time.sleep(0.005)
    while len(lines("a_live.csv")) < FRAMES:
        if ended.wait(0.02):
            return
    os.kill(os.getpid(), signal.SIGINT)


def lines(path: str) -> list[dict[str, str]]:
    return list(csv.DictReader(Path(path).read_text().splitlines())) if Path(path).exists() else []


@pytest.mark.full
def test_files_that_come_give_what_a_folder_of_them_gives(data_dir: Path, options: list[str]) -> None:
    ended = threading.Event()
    writer = threading.Thread(target=detect, args=(data_dir, ended))
    writer.start()
    try:
        assert main(["track", *options, *SMALL, "--idle", f"{PATIENCE:g}", "-o", "a.nc"]) == 0
    finally:
        ended.set()
        writer.join()
    assert len(list(Path("cam01").iterdir())) == FRAMES
    assert main(["track", *options, *SMALL, "--idle", "0.5", "-o", "b.nc"]) == 0
    came, whole = load_result("a.nc"), load_result("b.nc")
    for name in ("summary/state_mean", "posterior/markers", "observed_data/points", "inputs/noise"):
        np.testing.assert_array_equal(came[name].to_numpy(), whole[name].to_numpy())
    told = lines("a_live.csv")
    assert [(int(row["frame"]), float(row["time"])) for row in told] == [(t, round(t / 60, 6)) for t in range(FRAMES)]
    markers = came["summary"].coords["marker"].values.tolist()
    for end, expected in (("", came["summary/markers_mean"]), ("_upper", came["summary/markers_quantile"].sel(quantile=0.95))):
        places = [[[float(row[f"{marker}_{axis}{end}"]) for axis in "xyz"] for marker in markers] for row in told]
        np.testing.assert_allclose(places, expected, atol=0.006)
    assert all(float(row["latency_ms"]) > 0 for row in told)
    assert read_trc("a.trc").positions.shape[0] == FRAMES and Path("a.mot").is_file()


def test_nothing_comes(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *options, *SMALL, "--idle", "0.1", "-o", "out.nc"]) == 1
    assert "no frame came in 0.1 s" in capsys.readouterr().err
    assert sorted(path.name for path in Path().iterdir()) == [f"cam0{camera}" for camera in CAMERAS]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_lines_that_cannot_be_written_are_reported_and_cost_nothing(tmp_path: Path) -> None:
    notes: list[str] = []
    table = LiveTable(tmp_path / "full.csv", 60.0, notes.append)
    estimate = LiveEstimate([3, 4], *np.arange(18.0).reshape(3, 2, 1, 3))
    table.begin(["pelvis"])
    table.close()
    with Path("/dev/full").open("w", buffering=1) as full:
        table._stream = full
        table.write(estimate, [time.monotonic()] * 2)
        assert len(notes) == 1 and "No space left" in notes[0] and len(table.latencies) == 2


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (["--frames", "0:5"], "--frames is an option of poseppl track recording and observations and keypoints and points"),
        (["--camera", "cam_04:offset=3"], "--camera: frames with the same number are simultaneous"),
        (["--checkpoint", "run"], "--checkpoint is an option of poseppl track recording"),
        (["--walk", "learned"], "--walk learned needs the whole recording"),
        (["--detector", "deeplabcut"], "--detector: live folders have one file a frame"),
        (["cam_05=cam01"], "no camera 'cam_05' in the calibration"),
    ],
)
def test_what_does_not_go_with_it_is_reported(
    options: list[str], capsys: pytest.CaptureFixture[str], change: list[str], expected: str
) -> None:
    assert main(["track", *options, *SMALL, *change, "-o", "out.nc"]) in (1, 2)
    assert expected in capsys.readouterr().err


@pytest.mark.full
def test_folders_are_followed_and_files_are_not(data_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    calibration = str(data_dir / "pose2sim_balancing" / "calibration" / "Calib_qualisys.toml")
    Path("points.csv").write_text("scorer,a,a,a\n")
    for source, expected in (("points.csv", ", cam_01: a file (expected a folder"), ("nowhere", ": no such file")):
        given: list[Any] = ["--keypoints", f"cam_01={source}", "--calibration", calibration]
        assert main(["track", *given, "--live"]) == 1  # as before there was a command for it
        assert f"{source}{expected}" in capsys.readouterr().err


@pytest.mark.full
def test_live_options_alone(options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", "keypoints", *options[1:], "--idle", "3"]) == 2
    assert "--idle is an option of poseppl track live" in capsys.readouterr().err
