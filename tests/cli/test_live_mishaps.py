"""`poseppl track live` where not all goes well: few cameras, one that stops, folders that go, impatient users."""

from __future__ import annotations

import os
import re
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest
from balancing_options import words
from test_track_live import lines

from poseppl.cli import main
from poseppl.cli.track_live import LiveTable
from poseppl.motion.keypoints.live import LiveTrack
from poseppl.runs.results import load_result

pytestmark = pytest.mark.usefixtures("without_pictures")

FRAMES = 10
SMALL = ["--start", "0.08", "--wait", "0.05", "--idle", "0.5", "--filter", "kalman", "--max-draws", "50"]


@pytest.fixture
def copied(data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Folders here, of cameras with so many frames each; the options of the command."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(jax.config.jax_compilation_cache_dir))

    def copy(**frames: int) -> list[str]:
        for camera, count in frames.items():
            source = data_dir / "pose2sim_balancing" / "pose" / f"{camera}_json"
            Path(camera).mkdir()
            for file in sorted(source.glob("*.json"))[:count]:
                shutil.copy(file, camera)
        given = words(data_dir, *(int(camera[-1]) for camera in frames), source="live")
        return ["track", *(re.sub(r"=.*(cam0\d)_json", r"=\1", word) for word in given), *SMALL, "-o", "a.nc"]

    return copy


def points() -> np.ndarray:
    return load_result("a.nc")["observed_data/points"].to_numpy()


@pytest.mark.full
def test_a_camera_that_stops_sees_nobody_and_is_named(
    copied: Callable[..., list[str]], capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(copied(cam01=FRAMES, cam02=FRAMES, cam03=7)) == 0
    assert "cam_03: it has no file of frame 7, and sees nobody" in capfd.readouterr().err.replace("\n", " ")
    assert np.isfinite(points()).any((2, 3)).sum(0).tolist() == [FRAMES, FRAMES, 7] and len(lines("a_live.csv")) == FRAMES


@pytest.mark.full
def test_one_camera(copied: Callable[..., list[str]]) -> None:
    assert main([*copied(cam01=FRAMES), "--stature", "1730"]) == 0
    assert points().shape[:2] == (FRAMES, 1) and len(lines("a_live.csv")) == FRAMES


@pytest.mark.slow
def test_errors_of_a_detector_give_the_noise(data_dir: Path, copied: Callable[..., list[str]]) -> None:
    command = copied(cam01=FRAMES, cam02=FRAMES, cam03=FRAMES)
    assert main(["calibrate-detector", "openpose", *words(data_dir, 1, 2, 3, 4, source=""), "--frames", "0:100:10", "-q"]) == 0
    noise = []
    for more in ([], ["--noise", "openpose.json"], ["--noise", "openpose.json", "--start", "1"]):
        assert main([*command, *more]) == 0
        noise.append(load_result("a.nc")["inputs/noise"].to_numpy())
    plain, own, together = noise
    assert own.shape == (FRAMES, 3, plain.shape[2]) and not np.allclose(own, plain)
    np.testing.assert_allclose(own[5:], together[5:], rtol=0.02)  # the cameras are refined from other frames


@pytest.mark.full
def test_a_folder_that_is_deleted_costs_its_camera_alone(
    copied: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    add = LiveTrack.add

    def then_delete(self: LiveTrack, frame: object) -> object:
        shutil.rmtree("cam03", ignore_errors=True)
        return add(self, frame)  # type: ignore[arg-type]

    monkeypatch.setattr(LiveTrack, "add", then_delete)
    assert main(copied(cam01=FRAMES, cam02=FRAMES, cam03=FRAMES)) == 0
    told = re.sub(r"\s+", " ", capfd.readouterr().err)
    assert "cam_03: it sees nobody in frame" in told and "cam03" in told
    assert np.isfinite(points()).any((2, 3)).sum(0)[:2].tolist() == [FRAMES, FRAMES] and len(lines("a_live.csv")) == FRAMES


def interrupt(times: int, table: LiveTable) -> None:
    for _ in range(times if len(table.latencies) == FRAMES - 1 else 0):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.full
@pytest.mark.parametrize("times", [1, 2])
def test_interrupted_once_the_result_is_written_and_twice_it_lists_what_there_is(
    copied: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], times: int
) -> None:
    write = LiveTable.write

    def then_interrupt(self: LiveTable, *given: object) -> None:
        write(self, *given)  # type: ignore[arg-type]
        interrupt(times, self)

    monkeypatch.setattr(LiveTable, "write", then_interrupt)
    status, told = main(copied(cam01=FRAMES, cam02=FRAMES)), re.sub(r"\s+", " ", capfd.readouterr().err)
    assert status == (0 if times == 1 else 130)
    assert len(lines("a_live.csv")) == FRAMES - 1 and Path("a.nc").exists() == (times == 1)
    assert ("a_live.csv has the frames so far; poseppl track keypoints" in told) == (times == 2)


@pytest.mark.full
def test_a_disk_that_is_full_costs_the_table_or_is_reported(
    copied: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def full(*given: object) -> None:
        raise OSError(28, "No space left on device", "a.nc")

    monkeypatch.setattr("poseppl.cli.outputs.write_outputs", full)
    command = copied(cam01=FRAMES, cam02=FRAMES)
    assert main(command) == 1
    told = re.sub(r"\s+", " ", capfd.readouterr().err)
    assert "a_live.csv has the frames so far" in told and "poseppl: a.nc: No space left on device" in told
    assert len(lines("a_live.csv")) == FRAMES


@pytest.mark.full
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_table_that_cannot_be_begun_is_reported(tmp_path: Path) -> None:
    notes: list[str] = []
    for path in (Path("/dev/full"), tmp_path / "gone" / "a_live.csv"):
        table = LiveTable.__new__(LiveTable)
        table._path, table._rate, table._note, table._stream = path, 60.0, notes.append, None
        table.begin(["pelvis"])
        table.close()
    assert ["No space left" in notes[0], "No such file" in notes[1]] == [True, True]
