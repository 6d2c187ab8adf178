"""Does smoothing pay? Filters, and smoothers that are not restricted to the filter's particles, on walks in circles.

    POSEPPL_DATA=FOLDER python -m studies.smoothing_pays [--quick] [--cameras 1,2,4] [--seeds 3] [--output smoothing-pays]
        [--seen points] [--methods ...] [--frames 40]

Recorded walks are bent to circles of 1.2 m and seen at 30 Hz by one, two or four cameras. They are seen as points, with noise
of 0.003 focal lengths, or as silhouettes found in videos of 320 x 240 px of a rendered room with a camera in each corner; the
random walk then moves 40 mm a frame. The filter is the default tracker; a smoother takes its draws. The table has the mean
distance of the joints' means from the truth, mm, the coverage of central 50 % and 90 % intervals, and seconds a frame
(smoothers: with compilation). Rows in OUTPUT/smoothing_pays.csv are reused; OUTPUT/smoothing_pays.png draws those of points.
"""

from __future__ import annotations

import itertools
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from poseppl_papers.images.scenes import Scene as RenderedScene, see
from poseppl_papers.measured import mean_interval
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.io import VideoWarning
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.silhouettes.frame import SilhouetteSettings
from poseppl.motion.silhouettes.video_sources import DEFAULT_MODEL, see_silhouettes, sources_of_scene
from poseppl.motion.tracking import Scene, SmoothSettings, TrackSettings, observe_motion, smooth, track
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.report.picture import Picture, new_picture, save_picture
from studies.kept_runs import read_runs

WALKS, RADIUS, NOISE = ("05_01", "06_01", "16_16", "08_04"), 1200.0, 0.003
FILTER = "filter"
SMOOTHERS: dict[str, dict[str, Any]] = {
    "rauch-tung-striebel": {},
    "backward-simulation": {},
    "particle-mgrad": {},
    "trajectory": {"num_draws": 100},
}
POINTS, SILHOUETTES = "points", "silhouettes"
SIZE = 320, 240
"""Picture size of the videos, px."""
_KEY = 4
"""So many columns tell which run it was."""
_COLUMNS = ("walk", "seen", "cameras", "seed", "method", "error", "coverage_50", "coverage_90", "seconds")


def watch(data: Path, name: str, seen: str, cameras: int, num_frames: int, seed: int) -> Scene[Any]:
    """The first frames of a walk along a circle; silhouettes are the same for all seeds."""
    folder = data / "cmu_walks"
    skeleton = folder / f"{name.partition('_')[0]}.asf"
    if seen == SILHOUETTES:
        recording = Recording.of_file(f"w{name}", folder / f"{name}.amc", skeleton)
        scene = RenderedScene(recording, False, num_frames, 30.0, *SIZE, RADIUS)
        see(scene)  # renders it
        sources = sources_of_scene(scene.folder, camera_names(4)[:cameras])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VideoWarning)
            return see_silhouettes(sources, settings=SilhouetteSettings())
    subject = recorded_subject(folder / f"{name}.amc", skeleton, frames="::4", turn=RADIUS)
    placed = cameras_around(subject, count=cameras)
    return observe_motion(subject, placed, camera_names(cameras), noise=NOISE, seed=seed).first_frames(num_frames)


def judge(tree: xr.DataTree) -> tuple[float, float, float]:
    """Error, and coverage of 50 % and 90 % intervals."""
    draws = np.asarray(tree["posterior/markers"].values, np.float64)
    draws, truth = draws.reshape(-1, *draws.shape[2:]), np.asarray(tree["truth/markers"].values)
    error = np.linalg.norm(draws.mean(0) - truth, axis=-1).mean()
    bounds = [np.quantile(draws, [(1 - level) / 2, (1 + level) / 2], axis=0) for level in (0.5, 0.9)]
    shares = [float(np.mean((low <= truth) & (truth <= high))) for low, high in bounds]
    return float(error), shares[0], shares[1]


def runs_of(data: Path, key: tuple[str, str, str, str], methods: list[str], num_frames: int) -> list[tuple[Any, ...]]:
    """Rows of a walk, what is seen of it, cameras and a seed: the filter's and those of smoothers."""
    name, seen, cameras, seed = key
    other: dict[str, Any] = {"sigma_position": 40.0 * 30.0**0.5, "model": DEFAULT_MODEL} if seen == SILHOUETTES else {}
    scene = watch(data, name, seen, int(cameras), num_frames, int(seed))
    tracked = track(scene, TrackSettings(filter="assumed-density", seed=int(seed), **other))
    filtered = tracked.result
    rows = [(*key, FILTER, *judge(filtered), float(filtered.attrs["wall_seconds"]) / num_frames)]
    for method in methods:
        began = time.perf_counter()
        smoothed = smooth(tracked, SmoothSettings(method, SMOOTHERS[method], seed=int(seed)))
        rows.append((*key, method, *judge(smoothed), (time.perf_counter() - began) / num_frames))
    return rows


def draw(table: Table) -> Picture:
    """Reduction of the filter's error by each smoother, and coverage of 90 % intervals, over the number of cameras.

    By points, where there are any.
    """
    table = table._replace(rows=table.select(seen=POINTS) or table.rows)
    picture = new_picture(10.0, 3.6)
    gain, held = picture.subplots(1, 2)
    counts = sorted({row["cameras"] for row in table.records()}, key=int)
    for number, method in enumerate((FILTER, *SMOOTHERS)):
        places, gains, shares = np.arange(len(counts)) + 0.12 * (number - 2), [], []
        for cameras in counts:
            before, own = (table.column("error", method=each, cameras=cameras).astype(float) for each in (FILTER, method))
            gains.append(mean_interval(100 * (1 - own / before)))
            shares.append(mean_interval(100 * table.column("coverage_90", method=method, cameras=cameras).astype(float)))
        for axis, found in ((gain, gains), (held, shares)):
            if axis is held or method != FILTER:
                mean, low, high = np.array(found).T
                axis.errorbar(places, mean, yerr=[mean - low, high - mean], fmt="o", color=f"C{number}", label=method)
    held.axhline(90, color="#777777", linestyle=":", linewidth=1)
    gain.axhline(0, color="#777777", linestyle=":", linewidth=1)
    gain.set(ylabel="less error than the filter's, %")
    held.set(ylabel="coordinates in their 90 % intervals, %")
    for axis in (gain, held):
        axis.set(xlabel="cameras", xticks=np.arange(len(counts)), xticklabels=counts)
    handles, labels = held.get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    return picture


def main() -> None:
    options = arguments(
        __doc__, cameras="1,2,4", seen=POINTS, methods=",".join(SMOOTHERS), seeds=3, frames=40, output="smoothing-pays"
    )
    start_jax()
    data, output = DATA, options.output
    num_frames, seeds = (5, 1) if options.quick else (options.frames, options.seeds)
    about = "Runs of smoothing_pays.py: errors in mm, shares of the joints' coordinates, seconds a frame."
    table = Table("smoothing_pays", _COLUMNS, read_runs(output / "smoothing_pays.csv"), about)
    done = {row[:_KEY] for row in table.rows}
    wanted = itertools.product(map(str, range(seeds)), options.seen.split(","), options.cameras.split(","), WALKS)
    for seed, seen, cameras, name in wanted:
        if (name, seen, cameras, seed) not in done:
            for row in runs_of(data, (name, seen, cameras, seed), options.methods.split(","), num_frames):
                table.rows.append(tuple(f"{value:.5g}" if isinstance(value, float) else value for value in row))
                print(*table.rows[-1], flush=True)
            write_csv(table, output)
    save_picture(draw(table), output / "smoothing_pays.png")
    show("Runs", _COLUMNS, [[str(value) for value in row] for row in table.rows])


if __name__ == "__main__":
    main()
