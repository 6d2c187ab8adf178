"""`poseppl track --keypoints --live`: folders that a detector is writing to, filtered as the files come."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Event
from typing import Any

import click

from poseppl.cli.keypoint_words import about_person, calibration_of, words_of_keypoints
from poseppl.cli.live_table import LiveTable
from poseppl.cli.options import option_group, refuse
from poseppl.errors import InputError, PosepplError

START, WAIT, IDLE = 1.0, 1.0, 10.0
"""Seconds of the first frames, for which a camera is waited for, and without a frame after which there are no more."""
_ONLY = ("start", "wait", "idle")
_NOT_WITH = ("frames", "offset", "camera_rate", "prior")
_DETECTORS = (None, "openpose", "mmpose")
_SHOWN, _TOLD = 0.25, 30.0
"""Seconds between two signs of progress, on a terminal and elsewhere."""

live_options = option_group(
    click.option(
        "--live",
        is_flag=True,
        default=None,
        help="--keypoints: folders that a detector is writing to, one file a frame. Each frame is filtered as it comes, for a "
        "line of NAME_live.csv; the result is written at the end, which is --idle or Ctrl-C. Frames of the same number are of "
        "one time, and left and right are the detector's.",
    ),
    click.option(
        "--start",
        metavar="SECONDS",
        type=click.FloatRange(min=0),
        help=f"--live: the first frames with a person, which tell its size, the noise and the first pose. [default: {START:g}]",
    ),
    click.option(
        "--wait",
        metavar="SECONDS",
        type=click.FloatRange(min=0),
        help=f"--live: how long a camera's file is waited for once another camera has the frame. [default: {WAIT:g}]",
    ),
    click.option(
        "--idle",
        metavar="SECONDS",
        type=click.FloatRange(min=0, min_open=True),
        help=f"--live: end where no frame has come for so long. [default: {IDLE:g}]",
    ),
)
"""How growing folders are read."""


def check_live_usage(options: dict[str, Any]) -> None:
    """Refuse options that do not go with --live, or only with it."""
    if not options["live"]:
        refuse(_ONLY, "goes with --live")
        return
    if options["checkpoint"] is not None:
        raise click.UsageError("--checkpoint does not go with --live: all frames are in the folders, as a recording without it")
    refuse(_NOT_WITH, "does not go with --live")
    for name in ("walk", "markers"):
        if options[name] == "learned":
            raise click.UsageError(f"--{name} {options[name]} needs the whole recording, and does not go with --live")
    if options["skeleton"] is not None:
        raise click.UsageError("--live follows a person; points of a --skeleton need the whole recording")
    if options["detector"] not in _DETECTORS:
        raise click.UsageError(f"--live reads one file a frame, by openpose or mmpose; not by {options['detector']}")


def live_table(options: dict[str, Any], target: Path) -> list[Path]:
    """The table that --live writes, if it is asked for."""
    return [target.with_name(f"{target.stem}_live.csv")] if options.get("live") else []


def tell_lines_left(options: dict[str, Any], target: Path, progress: Any) -> None:
    """Tell what there is of --live where no result could be written."""
    for path in live_table(options, target):
        if path.exists():
            told = "the same command without --live makes the result of the folders' files"
            progress.note(f"{path} has the frames so far; {told}")


def track_live(options: dict[str, Any], settings: Any, target: Path, progress: Any) -> tuple[Any, str | None]:
    """Follow growing folders to their end: the result, and why it ends before, if it does.

    Args:
        options: Of the command.
        settings: How to track.
        target: The result's file.
        progress: Is told.

    Raises:
        InputError: A folder, a camera or the first frames cannot be used, or no frame comes.
    """
    from poseppl.cli.signals import signals_set
    from poseppl.motion.tracking.walk import ASSUMED_RATE

    rate = options["rate"]
    if rate is None:
        progress.note(f"nobody says how many frames a second there are: {ASSUMED_RATE:g} are assumed (--rate)")
    table = LiveTable(live_table(options, target)[0], rate or ASSUMED_RATE, progress.note)
    stop = Event()
    follower = _Follower(options, settings, rate, table, progress)
    problem = None
    try:
        with signals_set(stop):
            follower.follow(stop)
    except PosepplError as error:  # what was done is worth more than the command
        if follower.track is None:
            raise
        problem = str(error)
    finally:
        table.close()
    if follower.track is None:
        raise KeyboardInterrupt
    if not options["quiet"]:
        progress.note(table.latency(follower.first))
    tree = follower.track.finish(**({} if problem is None else {"stopped": problem}))
    return tree, problem and f"{problem}; the frames before it, {tree['posterior'].sizes['frame']}, are"


class _Follower:
    """The frames on their way from the folders to the table."""

    def __init__(self, options: dict[str, Any], settings: Any, rate: float | None, table: LiveTable, progress: Any) -> None:
        from poseppl.motion.io.growing_folders import GrowingFolders
        from poseppl.motion.keypoints.sources import check_cameras

        self._options, self._settings, self._rate, self._table, self._progress = options, settings, rate, table, progress
        self._folders = words_of_keypoints(options["keypoints"])
        self._calibration = calibration_of(options)
        check_cameras(self._folders, [record.name for record in self._calibration.cameras])
        self._wait, self._idle = (
            default if options[name] is None else options[name] for name, default in (("wait", WAIT), ("idle", IDLE))
        )
        self._source = GrowingFolders(
            self._folders, detector=options["detector"], wait=self._wait, idle=self._idle, note=progress.note
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

        start = START if self._options["start"] is None else self._options["start"]
        enough = max(1, round(start * (self._rate or ASSUMED_RATE)))
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
                raise InputError(f"no frame came in {self._idle:g} s", field="--keypoints", expected=expected)
            self._begin()

    def _begin(self) -> None:
        """Filter the first frames, and find what the others need."""
        from poseppl.motion.keypoints.live import LiveTrack

        options, self.first = self._options, len(self._waiting)
        self._progress.stage("compiling")
        self.track = LiveTrack(
            self._folders,
            self._calibration,
            self._waiting,
            self._settings,
            self._progress.note,
            rate=self._rate,
            model=self._settings.model,
            **about_person(options),
        )
        self._table.begin(self.track.markers)
        self._table.write(self.track.estimate, [frame.since for frame in self._waiting])
        self._waiting = []

    def _show(self, frame: Any) -> None:
        """Say how far it is."""
        now = time.monotonic()
        bar = self._progress.console.is_terminal
        if now - self._shown > (_SHOWN if bar else _TOLD) and not self._options["quiet"]:
            self._shown = now
            (self._progress.stage if bar else self._progress.note)(
                f"frame {frame.number}, {1e3 * self._table.latencies[-1]:.0f} ms behind"
            )
