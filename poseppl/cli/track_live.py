"""`poseppl track live`: folders that a detector is writing to, filtered as the files come, and its table, a line a frame."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any, TextIO

from poseppl.cli.checks import check_writable
from poseppl.cli.options import as_options
from poseppl.cli.track_run import Wanted, planned, report, write_results
from poseppl.errors import Argument, InputError, PosepplError
from poseppl.files.csv_fields import shielded
from poseppl.motion.keypoints.settings import LiveSettings
from poseppl.motion.settings import TrackSettings

_SHOWN, _TOLD = 0.25, 30.0
"""Seconds between two signs of progress, on a terminal and elsewhere."""


def track_live(source: LiveSettings, settings: TrackSettings, wanted: Wanted) -> None:
    """Follow growing folders to their end, and write the table and the result.

    Raises:
        PosepplError: A folder, a camera or the first frames cannot be used, no frame comes, or the run cannot go on.
    """
    from poseppl.cli.console import ConsoleProgress, start_jax
    from poseppl.threads import spare_threads

    spare_threads(settings.devices)  # here, since bodies start JAX as they are imported
    plan = planned(source, settings, wanted)
    lines = plan.target.with_name(f"{plan.target.stem}_live.csv")
    check_writable([lines], plan.inputs)
    progress = ConsoleProgress(wanted.quiet)
    start_jax(settings.devices)
    try:
        with progress.running():
            tree, problem = _followed(source, settings, lines, wanted.quiet, progress)
            written = write_results(tree, plan, progress, source.model, lambda: [("frame by frame", lines)])
    except (KeyboardInterrupt, OSError):
        if lines.exists():
            hint = "poseppl track keypoints makes the result of the folders' files"
            progress.note(f"{lines} has the frames so far; {hint}")
        raise
    report(written, plan.target, wanted.quiet, problem)


def _followed(source: LiveSettings, settings: TrackSettings, lines: Path, quiet: bool, progress: Any) -> tuple[Any, str | None]:
    """The result, and why it ends before the folders do, if it does."""
    from poseppl.cli.signals import signals_set
    from poseppl.motion.sources import with_body
    from poseppl.motion.tracking.walk import ASSUMED_RATE, UNKNOWN_RATE
    from poseppl.runs.algorithms import FILTERS

    source, settings = with_body(source, settings)
    FILTERS[str(settings.filter)].check(settings.options)
    if source.rate is None:
        progress.note(UNKNOWN_RATE)
    table = LiveTable(lines, source.rate or ASSUMED_RATE, progress.note)
    stop, problem = Event(), None
    follower = _Follower(source, settings, table, progress, quiet)
    try:
        with signals_set(stop):
            follower.follow(stop)
    except PosepplError as error:  # what was done is worth more than the command
        if follower.track is None:
            raise
        problem = as_options(error)
    finally:
        table.close()
    if follower.track is None:
        raise KeyboardInterrupt
    if not quiet:
        progress.note(table.latency(follower.first))
    tree = follower.track.finish(**({} if problem is None else {"stopped": problem}))
    return tree, problem and f"{problem}; the frames before it, {tree['posterior'].sizes['frame']}, are"


class _Follower:
    """The frames on their way from the folders to the table."""

    def __init__(self, source: LiveSettings, settings: TrackSettings, table: LiveTable, progress: Any, quiet: bool) -> None:
        from poseppl.motion.io.cameras import calibration_of
        from poseppl.motion.io.growing_folders import GrowingFolders
        from poseppl.motion.keypoints.sources import check_cameras

        calibration = calibration_of(source)
        check_cameras(source.files, [record.name for record in calibration.cameras])
        self._of, self._settings = replace(source, calibration=calibration), settings
        self._table, self._progress, self._quiet = table, progress, quiet
        self._source = GrowingFolders(
            source.files, detector=source.detector, wait=source.wait, idle=source.idle, note=progress.note
        )
        self._waiting: list[Any] = []
        self._seen, self._shown = 0, time.monotonic()
        self.track: Any = None
        self.first = 0
        """How many frames came before the first that was filtered alone."""

    def follow(self, stop: Event) -> None:
        """Take frames until there are no more, or one is asked to stop."""
        from poseppl.motion.keypoints.live import sees_someone
        from poseppl.motion.tracking.walk import ASSUMED_RATE

        enough = max(1, round(self._of.start * (self._of.rate or ASSUMED_RATE)))
        self._progress.stage(f"waiting for {enough} frames with a person")
        for frame in self._source.frames(stop):
            if self.track is not None:
                self._table.write(self.track.add(frame), [frame.since])
                self._show(frame)
                continue
            self._waiting.append(frame)
            self._seen += sees_someone(frame)
            if self._seen >= enough:
                self._begin()
        if self.track is None and not stop.is_set():
            if not self._waiting:
                expected = "files of the same frame numbers in two folders, or in the only one"
                raise InputError(f"no frame came in {self._of.idle:g} s", field=Argument("files"), expected=expected)
            self._begin()

    def _begin(self) -> None:
        """Filter the first frames, and find what the others need."""
        from poseppl.motion.keypoints.live import LiveTrack

        self.first = len(self._waiting)
        self._progress.stage("compiling")
        self.track = LiveTrack(self._of, self._waiting, self._settings, self._progress.note)
        self._table.begin(self.track.markers)
        self._table.write(self.track.estimate, [frame.since for frame in self._waiting])
        self._waiting = []

    def _show(self, frame: Any) -> None:
        """Say how far it is."""
        now = time.monotonic()
        bar = self._progress.console.is_terminal
        if now - self._shown > (_SHOWN if bar else _TOLD) and not self._quiet:
            self._shown = now
            (self._progress.stage if bar else self._progress.note)(
                f"frame {frame.number}, {1e3 * self._table.latencies[-1]:.0f} ms behind"
            )


class LiveTable:
    """A table to which a line is added for each frame, at once.

    Args:
        path: The file.
        rate: Frames a second.
        note: Receives a message if a line cannot be written.

    Attributes:
        latencies: Seconds from when a frame's files were there to its line.
    """

    def __init__(self, path: Path, rate: float, note: Callable[[str], None]) -> None:
        self._path, self._rate, self._note = path, rate, note
        self._stream: TextIO | None = None
        self.latencies: list[float] = []
        path.unlink(missing_ok=True)

    def begin(self, markers: Sequence[str]) -> None:
        """Write the head."""
        try:
            self._stream = self._path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            self._tell(error)
        places = [f"{marker}_{axis}{end}" for marker in markers for axis in "xyz" for end in ("", "_lower", "_upper")]
        self._add(["frame", "time", "latency_ms", *places])

    def write(self, estimate: Any, since: Sequence[float]) -> None:
        """Write the lines of frames, whose files were there at some times."""
        for t, (frame, came) in enumerate(zip(estimate.frames, since, strict=True)):
            ends = (estimate.mean[t], estimate.lower[t], estimate.upper[t])
            places = [f"{end[k, axis]:.2f}" for k in range(len(ends[0])) for axis in range(3) for end in ends]
            self.latencies.append(time.monotonic() - came)
            self._add([str(frame), f"{frame / self._rate:.6f}", f"{1e3 * self.latencies[-1]:.1f}", *places])

    def _add(self, fields: Sequence[str]) -> None:
        try:
            if self._stream is not None:
                csv.writer(self._stream, lineterminator="\n").writerow(map(shielded, fields))
        except OSError as error:
            self._tell(error)
            self.close()

    def _tell(self, error: OSError) -> None:
        self._note(f"{self._path}: no more lines, but the run continues: {error.strerror}")

    def close(self) -> None:
        """No more lines."""
        with suppress(OSError):  # a full disk was reported
            if self._stream is not None:
                self._stream.close()
        self._stream = None

    def latency(self, first: int) -> str:
        """How long frames took, but for the first ones: a sentence."""
        import numpy as np

        seconds = self.latencies[first:]
        if not seconds:
            return "all frames were among the first ones"
        middle, most = 1e3 * np.quantile(seconds, [0.5, 0.95])
        return (
            f"{len(seconds)} frames after the first ones: from a frame's last file to its line {middle:.0f} ms in the median, "
            f"{most:.0f} ms at the 95th percentile; a frame lasts {1e3 / self._rate:.0f} ms"
        )
