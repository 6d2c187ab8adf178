"""Cost of predictive checks in a track: the built-in walk, with and without them, in turns.

    python -m benchmarks.predictive_cost [--quick] [--filters assumed-density,kalman,particle] [--cameras 2]
        [--frames 60] [--runs 5]

Seconds of compilation (without a cache) and of a run, by the clock and of the processor: medians over runs without the first,
which compiles. `poseppl track` makes the checks wherever the likelihood predicts data.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax

from benchmarks.timing import arguments, show, without_compile_cache
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import make_problem, observe_motion
from poseppl.motion.tracking.placing import camera_names, place_cameras
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.run import Run, run_filter

DRAWS = 100
"""Draws that are kept of a frame."""


class Cost(NamedTuple):
    """Seconds."""

    compile: float
    clock: float
    processor: float


def main() -> None:
    options = arguments(__doc__, filters="assumed-density,kalman,particle", cameras=2, frames=60, runs=5)
    without_compile_cache()
    frames, repetitions = (4, 1) if options.quick else (options.frames, options.runs)
    walk = walking_subject(frames=f"0:{frames}")
    cameras = place_cameras(walk.markers[:, 0], 0.0, count=options.cameras)
    problem = make_problem(observe_motion(walk, cameras, camera_names(options.cameras)))
    rows = []
    for name in options.filters.split(","):
        filter, settings = FILTERS[name].build(problem.model, {})
        collect = problem.collector(max(1, DRAWS // int(settings.get("num_chains", 1))))
        checks = {"without": None, "with": predictive_checks(problem.model)}

        def run(predict: Any, filter: Any = filter, collect: Any = collect) -> Run:
            key = jax.random.key(0)
            return run_filter(filter, key, problem.observations, problem.inputs, collect=collect, predict=predict)

        costs = in_turns(
            {which: lambda predict=predict, run=run: run(predict) for which, predict in checks.items()}, repetitions
        )
        without, checked = costs["without"], costs["with"]
        for which, cost in costs.items():
            rows.append([name, which, *(f"{seconds:.3g}" for seconds in cost)])
        shares = [f"{100 * (one - other) / one:.0f} %" for one, other in zip(checked, without, strict=True)]
        rows.append([name, "share of the checks", *shares])
    show(
        f"{frames} frames, {options.cameras} cameras", ["filter", "checks", "compilation, s", "clock, s", "processor, s"], rows
    )


def in_turns(rivals: dict[str, Callable[[], Run]], repetitions: int) -> dict[str, Cost]:
    """Run each in turns, and once before for its compilation."""
    compiled = {name: run().compile_seconds for name, run in rivals.items()}
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in rivals}
    for _ in range(repetitions):
        for name, run in rivals.items():
            started = time.process_time()
            seconds[name].append((run().wall_seconds, time.process_time() - started))
    return {
        name: Cost(compiled[name], *(statistics.median(each) for each in zip(*values, strict=True)))
        for name, values in seconds.items()
    }


if __name__ == "__main__":
    main()
