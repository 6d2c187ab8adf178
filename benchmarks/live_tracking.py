"""Time of a live frame, from its files, against the same frames in one go.

    POSEPPL_DATA=FOLDER python -m benchmarks.live_tracking [--quick] [--frames 300] [--filters kalman,assumed-density]

Folders of four cameras with OpenPose's files of pose2sim_balancing, played forwards and backwards, exist from the start, so
that the reader never waits. `poseppl track live` takes its first second (60 frames) as one. For each later frame it reads the
files, finds the person, filters, checks the prediction, summarises the draws, and writes a line of the table. The run in one go
has only the filter, the checks and the summaries. Milliseconds are of the processor, without compilation; frames a second are
by the clock, and other work on the machine lowers them. Different numbers are a failure.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Any

import jax
import numpy as np

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.cli.track_live import LiveTable
from poseppl.motion.io import read_calibration
from poseppl.motion.io.growing_folders import GrowingFolders, KeypointFrame
from poseppl.motion.keypoints.live import LiveTrack
from poseppl.motion.keypoints.settings import LiveSettings
from poseppl.motion.tracking import TrackSettings
from poseppl.runs.run import run_filter

RATE, FIRST, UNCOUNTED = 60.0, 60, 5
"""Frames a second, frames that are taken as one, and frames after them that are not counted."""


class Lap:
    """Milliseconds of the processor for a frame, and frames a second, of so many frames since it began."""

    def __init__(self) -> None:
        self._processor, self._clock = time.process_time(), time.perf_counter()

    def of(self, frames: int) -> tuple[float, float]:
        """Both, until now."""
        return 1e3 * (time.process_time() - self._processor) / frames, frames / (time.perf_counter() - self._clock)


def played(recording: Path, folder: Path, frames: int) -> dict[str, Path]:
    """Folders by camera, whose files are the recording's, forwards and backwards."""
    found = {}
    for camera in (1, 2, 3, 4):
        files = sorted((recording / "pose" / f"cam0{camera}_json").glob("*.json"))
        name = f"cam_0{camera}"
        found[name] = folder / name
        found[name].mkdir()
        for number, file in zip(range(frames), itertools.cycle([*files, *files[-2:0:-1]]), strict=False):
            (found[name] / f"{name}_{number:012d}_keypoints.json").symlink_to(file.resolve())
    return found


def live(track: LiveTrack, frames: Iterator[KeypointFrame], table: LiveTable, count: int) -> tuple[float, float]:
    """Read frames and track them live."""
    lap = Lap()
    for frame in itertools.islice(frames, count):
        table.write(track.add(frame), [frame.since])
    return lap.of(count)


def in_one_go(track: LiveTrack) -> tuple[Any, tuple[float, float]]:
    """The run of all frames."""
    whole = track.whole()
    problem = whole.problem
    how: Any = {"collect": whole.collect, "predict": whole.predict, "num_frames": len(whole.scene.frames)}
    for _ in range(2):  # the first one compiles
        lap = Lap()
        run = run_filter(whole.filter, jax.random.key(0), problem.observations, problem.inputs, **how)
    return run, lap.of(how["num_frames"])


def measure(filter: str, recording: Path, folders: dict[str, Path], scratch: Path, count: int) -> list[str]:
    """A row of the table."""
    calibration = read_calibration(recording / "calibration" / "Calib_qualisys.toml", "m")
    frames = GrowingFolders(folders).frames(Event())
    first = list(itertools.islice(frames, FIRST))
    track = LiveTrack(LiveSettings(folders, calibration, rate=RATE), first, TrackSettings(filter=filter), lambda note: None)
    table = LiveTable(scratch / "live.csv", RATE, print)
    table.begin(track.markers)
    live(track, frames, table, UNCOUNTED)
    one_by_one = live(track, frames, table, count)
    run, together = in_one_go(track)
    tree = track.finish()
    np.testing.assert_array_equal(tree["summary/markers_mean"].to_numpy(), run.outputs.summary["markers_mean"])
    return [filter, *(f"{value:.1f}" for value in (*one_by_one, *together)), f"{one_by_one[0] / together[0]:.2f}"]


def main() -> None:
    options = arguments(__doc__, frames=300, filters="kalman,assumed-density")
    start_jax()
    recording = Path(os.environ["POSEPPL_DATA"]) / "pose2sim_balancing"
    count = 10 if options.quick else options.frames
    with TemporaryDirectory() as name:
        folders = played(recording, Path(name), FIRST + UNCOUNTED + count)
        names = ["kalman"] if options.quick else options.filters.split(",")
        rows = [measure(filter, recording, folders, Path(name), count) for filter in names]
    columns = ("filter", "live, ms a frame", "frames/s", "in one go, ms a frame", "frames/s", "ratio of ms")
    show(f"{count} frames of four cameras", columns, rows)


if __name__ == "__main__":
    main()
