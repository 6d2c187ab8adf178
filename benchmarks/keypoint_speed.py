"""How fast four cameras' keypoints become motion: seconds of a first run, which compiles, and of later ones.

    POSEPPL_DATA=FOLDER python -m benchmarks.keypoint_speed [--quick] [--repetitions 3] [--output keypoint-speed]

The man on a beam of pose2sim_balancing, 100 frames of 25 points of OpenPose in four cameras. The rows are reading the files,
and finding the person and his sizes; the default, a smoother of autocorrelated errors without a filter; filters, and smoothers
after them. These are the smoother of autocorrelated errors, and that of Rauch, Tung and Striebel, of independent errors. Errors
are distances of joints from the triangulation by all four cameras. Nothing is taken from the compile cache; seconds are of the
clock, the median of those after the first.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show, without_compile_cache, write_table
from poseppl.cli.console import start_jax
from poseppl.motion.tracking import SmoothSettings, TrackSettings, smooth, smooth_recording, track
from studies.keypoints import places_of, scene_of

NAME, FOLDER, CAMERAS = "keypoint_speed", "pose2sim_balancing", (1, 2, 3, 4)
_COLUMNS = ("part", "first_seconds", "seconds", "error", "error_95")
_ABOUT = (
    "Seconds of each part; errors are distances of joints from the triangulation by all cameras, mm: median, 95th percentile."
)
STRAIGHT, ONLINE, KALMAN = "smoother without a filter", "filter, assumed density", "filter, Kalman"
FILTERS = {ONLINE: TrackSettings(), KALMAN: TrackSettings(filter="kalman")}
LASTING, INDEPENDENT = SmoothSettings("laplace", errors="lasting"), SmoothSettings("rauch-tung-striebel")
SMOOTHERS = {
    "smoother, autocorrelated errors": (ONLINE, LASTING),
    "the same after the Kalman filter": (KALMAN, LASTING),
    "smoother, Rauch-Tung-Striebel": (KALMAN, INDEPENDENT),
}
"""Filters that smoothers start from, and settings."""


def timed(run: Callable[[], Any], repetitions: int) -> tuple[Any, float, float]:
    """Run a function; return its value, and the seconds of its first run and of later ones, by their median."""
    seconds = []
    for _ in range(repetitions + 1):
        started = time.perf_counter()
        found = run()
        seconds.append(time.perf_counter() - started)
    return found, seconds[0], statistics.median(seconds[1:])


def errors(tree: Any, reference: Any) -> tuple[float, float]:
    """Median and 95th percentile of the distances of joints from their reference (T, K, 3), mm."""
    distance = np.linalg.norm(tree["summary/markers_mean"].to_numpy() - reference, axis=-1)
    median, worst = np.nanquantile(distance, [0.5, 0.95])
    return float(median), float(worst)


def main() -> None:
    """Print the table and write it to OUTPUT."""
    options = arguments(__doc__, repetitions=3, output="keypoint-speed")
    repetitions, num_frames = (1, 6) if options.quick else (options.repetitions, 100)
    start_jax()
    without_compile_cache()
    scene, *seconds = timed(lambda: scene_of(DATA / FOLDER, CAMERAS, f"0:{num_frames}"), repetitions)
    reference, trees = places_of(scene), {}
    rows: list[tuple[Any, ...]] = [("files to points of a person", *seconds, np.nan, np.nan)]
    tree, *seconds = timed(lambda: smooth_recording(scene.scene).result, repetitions)
    rows.append((STRAIGHT, *seconds, *errors(tree, reference)))
    for name, settings in FILTERS.items():
        trees[name], *seconds = timed(lambda settings=settings: track(scene.scene, settings).result, repetitions)  # type: ignore[misc]
        rows.append((name, *seconds, *errors(trees[name], reference)))
    for name, (start, chosen) in SMOOTHERS.items():
        tree, *seconds = timed(lambda start=trees[start], chosen=chosen: smooth(start, chosen), repetitions)  # type: ignore[misc]
        rows.append((name, *seconds, *errors(tree, reference)))
    note = f"{num_frames} frames of four cameras; nothing from the compile cache"
    write_table(Table(NAME, _COLUMNS, rows, _ABOUT), options.output, str(repetitions), FOLDER, note)
    shown = [[row[0], *(f"{value:,.1f}" for value in row[1:])] for row in rows]
    show("Keypoints of four cameras", ["part", "first run, s", "later, s", "error, mm", "95 %"], shown)


if __name__ == "__main__":
    main()
