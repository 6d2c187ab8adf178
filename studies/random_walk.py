"""How far should a random walk go per frame? The default tracker on recordings of many rates, with three walks.

    POSEPPL_DATA=FOLDER python -m studies.random_walk [--quick] [--recordings ...] [--walks frame,second,learned]
        [--cameras 1,2] [--frames 100] [--runs 3] [--output random-walk]

"frame" is 15 mm and 0.15 radians a frame at any rate. "second" is the same at 30 Hz and scales with the square root of time.
"learned" has the scales with the highest likelihood in the recording (`--walk learned` of `poseppl track`). At 30 Hz "frame"
equals "second". Recordings have their own rate, or are thinned to 30 Hz.

Errors are mean distances of posterior means of the joints from the truth, mm. Coverage is that of 90 % intervals of the joints'
coordinates. Seconds include learning, but no compilation. In pose2sim_balancing a detector's points are tracked; the error is
against the published triangulation of twelve joints. Runs differ by the seed of noise and filter; the table has their means and
standard deviations. Runs in OUTPUT/runs.csv are reused.
"""

from __future__ import annotations

import itertools
import json
import statistics
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from poseppl_models.bodies.choo_fleet import full_body
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics.calibration import between
from poseppl.filters import assumed_density_filter
from poseppl.motion.io import read_cameras
from poseppl.motion.measures import joint_error
from poseppl.motion.recordings.subjects import recorded_subject
from poseppl.motion.tracking import Problem, Scene, make_problem, observe_motion
from poseppl.motion.tracking.placing import camera_names, cameras_around, cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.scene import noise_of
from poseppl.motion.tracking.walk import ASSUMED_RATE
from poseppl.motion.tracking.walk_learning import learn_walk
from poseppl.program import CompiledModel
from poseppl.runs.results import QUANTILES
from poseppl.runs.run import run_filter
from studies.balancing import STATURE, errors, read_triangulation
from studies.kept_runs import keep_run, read_runs

BALANCING = "pose2sim_balancing"
_CMU = {
    f"{number}{thinned}": (f"{folder}/{number}.amc", f"{folder}/{number[:2]}.asf", start, step)
    for folder, number, start, step, thinned in (
        ("cmu_amc", "02_01", 100, 1, ""),
        ("cmu_amc", "02_03", 40, 1, ""),
        ("cmu_amc", "02_03", 0, 4, " at 30"),
        ("cmu_amc", "02_04", 150, 1, ""),
        ("cmu_amc", "02_04", 0, 4, " at 30"),
        ("cmu_amc", "02_05", 600, 1, ""),
        ("cmu_amc", "02_06", 600, 1, ""),
        ("cmu_amc", "03_01", 100, 1, ""),
        ("cmu_walks", "07_06", 50, 1, ""),
        ("cmu_walks", "08_04", 50, 1, ""),
        ("cmu_walks", "16_47", 0, 1, ""),
        ("cmu_walks", "35_28", 0, 1, ""),
    )
}
_CLIPS = {
    name: (f"deepmimic/humanoid3d_{name}.txt", "deepmimic/humanoid3d.txt", 0, 1)
    for name in ("walk", "run", "dance_a", "dance_b")
}
RECORDINGS: dict[str, tuple[str, str | None, int, int]] = {
    **_CMU,
    **_CLIPS,
    "12_01": ("pybvh/cmu_12_01_walk.bvh", None, 100, 1),
    "walk1": ("makehuman/walk1.bvh", None, 0, 1),
    "walking_1": ("cmu_expmap/train_walking/walking_1.txt", "cmu_expmap/skeleton.json", 0, 1),
    "FlatFoot": ("btk_c3d/PiG_Motion-FlatFoot-Full.c3d", None, 100, 1),
}
"""File, skeleton, first frame and step."""
_DETECTED = {
    **{f"{part}_{side}": 5 + 2 * i + (side == "r") for i, part in enumerate(("shoulder", "elbow", "wrist")) for side in "lr"},
    **{f"{part}_{side}": 11 + 2 * i + (side == "r") for i, part in enumerate(("hip", "knee", "ankle")) for side in "lr"},
    "crown": 18,
}
"""Number of each marker among OpenPose's BODY_25B."""
_COLUMNS = ("recording", "rate", "cameras", "walk", "frames", "seed", "error", "coverage", "seconds", "learning")
_KEY = 6


class Watched(NamedTuple):
    """A scene for each seed, and the triangulation where that stands for the truth."""

    scenes: list[Scene[PointData]]
    reference: dict[str, Any] | None = None


def main() -> None:
    names = ",".join([*RECORDINGS, BALANCING])
    options = arguments(
        __doc__, recordings=names, walks="frame,second,learned", cameras="1,2", frames=100, runs=3, output="random-walk"
    )
    start_jax()
    folder, output = DATA, options.output
    frames, runs = (5, 1) if options.quick else (options.frames, options.runs)
    table = Table("runs", _COLUMNS, read_runs(output / "runs.csv"), "Runs of random_walk.py; mm and seconds.")
    trackers: dict[tuple[int, bool], Tracker] = {}
    for cameras, name in itertools.product(map(int, options.cameras.split(",")), options.recordings.split(",")):
        if name == BALANCING and cameras == 1:
            continue
        watched = (
            watch_keypoints(folder / name, frames, runs) if name == BALANCING else watch(folder, name, cameras, frames, runs)
        )
        kind = (cameras, name == BALANCING)  # whose cameras have a distortion, and another program therefore
        if kind not in trackers:
            trackers[kind] = Tracker(watched.scenes[0])
        for walk, (seed, scene) in itertools.product(options.walks.split(","), enumerate(watched.scenes)):
            key = (name, f"{scene.rate:g}", str(cameras), walk, str(len(scene.frames)), str(seed))
            same = walk == "frame" and scene.rate == ASSUMED_RATE
            if same or key in {row[:_KEY] for row in table.rows}:
                continue
            summary, *seconds = trackers[kind].run(scene, walk, seed)
            found = (*measured(scene, summary, watched.reference), *seconds)
            keep_run(table, (*key, *(f"{value:.5g}" for value in found)), output)
    columns = ["recording", "Hz", "cameras", "walk", "frames", "error, mm", "coverage, %", "s", "s of learning"]
    show("Mean ± standard deviation over runs", columns, summed(table.rows))


def watch(folder: Path, name: str, cameras: int, frames: int, runs: int) -> Watched:
    """A recording in front of placed cameras, with the noise of each seed."""
    file, skeleton, start, step = RECORDINGS[name]
    beside = None if skeleton is None else folder / skeleton
    whole = recorded_subject(folder / file, beside, frames=f"{start}::{step}")
    count = min(frames, len(whole.frames))
    subject = whole._replace(states=whole.states[:count], markers=whole.markers[:count], frames=whole.frames[:count])
    placed, named = cameras_around(subject, count=cameras), camera_names(cameras)
    return Watched([observe_motion(subject, placed, named, seed=seed) for seed in range(runs)])


def watch_keypoints(folder: Path, frames: int, runs: int) -> Watched:
    """Detections of the man on the beam in two opposite cameras; seeds are those of the filter alone."""
    body = full_body({name: value * STATURE / 1750.0 for name, value in full_body().lengths.items()})
    records = [read_cameras(folder / "calibration" / "Calib_qualisys.toml")[camera] for camera in (0, 2)]
    points = np.full((frames, 2, len(body.tree.marker_names), 2), np.nan)
    for row, camera in enumerate((1, 3)):
        files = sorted((folder / "pose" / f"cam{camera:02d}_json").glob("*.json"))[:frames]
        for frame, file in enumerate(files):
            people = [np.reshape(person["pose_keypoints_2d"], (-1, 3)) for person in json.loads(file.read_text())["people"]]
            found = max(people, key=lambda person: person[11:17, 2].sum(), default=None)
            for marker, number in _DETECTED.items() if found is not None else ():
                if found[number, 2] > 0.3:
                    points[frame, row, body.tree.marker_names.index(marker)] = found[number, :2]
    cameras = cameras_of_records(records)
    scene = Scene(
        body,
        cameras,
        tuple(record.name for record in records),
        PointData(points, noise_of(body, cameras, None)),
        np.arange(frames),
        60.0,
        BALANCING,
    )
    return Watched([scene] * runs, read_triangulation(folder / "reference" / "Balancing_for_IK.trc", frames))


def shared_problem(scene: Scene[PointData], model: CompiledModel | None) -> Problem:
    """The scene's problem, by the model of another scene if there is one: limbs are inputs, so that a program serves all."""
    problem = make_problem(scene)
    return problem if model is None else problem._replace(model=model)


class Tracker:
    """The default tracker of so many cameras, compiled once."""

    def __init__(self, scene: Scene[PointData]) -> None:
        self.model = shared_problem(scene, None).model
        self.filter, self.collect = assumed_density_filter(self.model), shared_problem(scene, self.model).collector(2)

    def run(self, scene: Scene[PointData], walk: str, seed: int) -> tuple[dict[str, Any], float, float]:
        """Summary of a run, its seconds, and those of learning; compilation left out."""
        problem = shared_problem(scene._replace(rate=ASSUMED_RATE) if walk == "frame" else scene, self.model)
        learning = 0.0
        if walk == "learned":
            learn_walk(problem)  # compiles
            started = time.perf_counter()
            problem = jax.block_until_ready(learn_walk(problem))
            learning = time.perf_counter() - started
        run = run_filter(self.filter, jax.random.key(seed), problem.observations, problem.inputs, collect=self.collect)
        return run.outputs.summary, run.wall_seconds + learning, learning


def measured(scene: Scene[PointData], summary: dict[str, Any], reference: dict[str, Any] | None) -> tuple[float, float]:
    """Mean error of the joints, mm, and the share of their coordinates inside of 90 % intervals."""
    if reference is not None:
        return errors(scene.body.tree.marker_names, summary["markers_mean"], reference)[0], float("nan")
    low, high = (summary["markers_quantile"][:, QUANTILES.index(level)] for level in (0.05, 0.95))
    seen = np.isfinite(scene.markers)
    error = joint_error(summary["markers_mean"], scene.markers).absolute
    return float(np.nanmean(error)), float(between(low, high, scene.markers)[seen].mean())


def summed(rows: Sequence[tuple[str, ...]], count: int = _KEY) -> list[list[str]]:
    """Mean and standard deviation over seeds, of rows of which `count` columns, the seed last, say what was run."""
    groups: dict[tuple[str, ...], list[tuple[float, ...]]] = {}
    for row in rows:
        groups.setdefault(row[: count - 1], []).append(tuple(map(float, row[count:])))
    shown = []
    for key, values in groups.items():
        error, coverage, seconds, learning = zip(*values, strict=True)
        deviation = f" ± {statistics.stdev(error):.0f}" if len(error) > 1 else ""
        shown.append(
            [*key, f"{statistics.mean(error):.0f}{deviation}", f"{100 * statistics.mean(coverage):.0f}"]
            + [f"{statistics.median(each):.2g}" for each in (seconds, learning)]
        )
    return shown


if __name__ == "__main__":
    main()
