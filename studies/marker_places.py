"""The cost of assumed marker positions, and the gain of learning them.

    POSEPPL_DATA=FOLDER python -m studies.marker_places [--quick] [--recordings ...] [--cameras 2,4] [--frames 100]
        [--runs 3] [--filter kalman] [--output marker-places]

Placed cameras see recordings, whose joints a body of rigid parts follows only roughly. They are tracked with fixed and learned
scales of the random walk, and with fixed and learned marker positions (`--walk` and `--markers` of `poseppl track`). Errors are
mean distances of posterior means of the joints from the truth, mm. Coverage is that of 90 % intervals of the joints'
coordinates. Seconds include learning, but no compilation. Runs differ by the seed of noise and filter; those in
OUTPUT/marker_places.csv are reused.
"""

from __future__ import annotations

import itertools
import time
from typing import Any

import jax
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.motion.tracking import Problem, Scene, make_problem
from poseppl.motion.tracking.marker_learning import learn_markers
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.walk_learning import learn_walk
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.run import run_filter
from studies.kept_runs import keep_run, read_runs
from studies.random_walk import RECORDINGS, measured, summed, watch

_COLUMNS = ("recording", "rate", "cameras", "walk", "markers", "frames", "seed", "error", "coverage", "seconds", "learning")
_KEY = 7
_ABOUT = "Mean error of the joints, mm; share of their coordinates in 90 % intervals; seconds with learning, and of learning."


def main() -> None:
    options = arguments(
        __doc__, recordings=",".join(RECORDINGS), cameras="2,4", frames=100, runs=3, filter="kalman", output="marker-places"
    )
    start_jax()
    folder, output = DATA, options.output
    frames, runs = (5, 1) if options.quick else (options.frames, options.runs)
    table = Table("marker_places", _COLUMNS, read_runs(output / "marker_places.csv"), _ABOUT)
    done = {row[:_KEY] for row in table.rows}
    for cameras, name in itertools.product(map(int, options.cameras.split(",")), options.recordings.split(",")):
        scenes = watch(folder, name, cameras, frames, runs).scenes
        for (seed, scene), walk, markers in itertools.product(enumerate(scenes), ("fixed", "learned"), ("fixed", "learned")):
            key = (name, f"{scene.rate:g}", str(cameras), walk, markers, str(len(scene.frames)), str(seed))
            if key in done:
                continue
            keep_run(table, (*key, *(f"{value:.5g}" for value in run(scene, options.filter, walk, markers, seed))), output)
    columns = ["recording", "Hz", "cameras", "walk", "markers", "frames", "error, mm", "coverage, %", "s", "s of learning"]
    show("Mean ± standard deviation over runs", columns, summed(table.rows, _KEY))


def run(scene: Scene[PointData], filter: str, walk: str, markers: str, seed: int) -> tuple[float, ...]:
    """Error, coverage, seconds and those of learning; compilation left out."""
    _learned(scene, walk, markers)  # compiles
    started = time.perf_counter()
    problem = jax.block_until_ready(_learned(scene, walk, markers))
    learning = time.perf_counter() - started
    built, _ = FILTERS[filter].build(problem.model, {})
    collect: Any = problem.collector(2)
    found = run_filter(built, jax.random.key(seed), problem.observations, problem.inputs, collect=collect)
    return *measured(scene, found.outputs.summary, None), found.wall_seconds + learning, learning


def _learned(scene: Scene[PointData], walk: str, markers: str) -> Problem:
    seen = learn_markers(scene, scene.body.params) if markers == "learned" else scene
    problem = make_problem(seen)
    return learn_walk(problem) if walk == "learned" else problem


if __name__ == "__main__":
    main()
