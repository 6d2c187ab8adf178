"""Compile time that XLA's fusion emitters for the CPU cost, and run time that they save, by filter.

    python -m benchmarks.fusion_emitters [--quick] [--frames 64] [--turns 3]

Programs of at most 10,000 particles are compiled without them (`poseppl.compilation`). A camera sees the 28-DOF body; a
filter runs in a process of its own, without a compile cache, with and without the emitters in turns. Seconds are of the
processor: those by which a first run takes longer than the fastest of five later ones, and those of this one; the median over
turns.
"""

from __future__ import annotations

import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import jax

from benchmarks.simulated import build_problem, draw_sequence
from benchmarks.timing import arguments, show, without_compile_cache
from poseppl import compilation
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import Constant, run_filter

CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("kalman", {}),
    ("assumed-density", {}),
    ("hmc", {}),
    ("particle", {"num_particles": 10_000}),
    ("particle", {"num_particles": 100_000}),
)


def measure(name: str, settings: dict[str, Any], frames: int, limit: int) -> tuple[float, float]:
    """Processor seconds of compilation and of a run; programs of at most `limit` particles do without emitters."""
    without_compile_cache()
    compilation.MAX_PARTICLES = limit
    problem = build_problem()
    observations = draw_sequence(problem, 0, frames).observations
    filter, collect = FILTERS[name].build(problem.model, settings)[0], collect_draws(problem.model, max_draws=100)
    seconds = []
    for _ in range(6):
        started = time.process_time()
        run_filter(filter, jax.random.key(0), observations, Constant(problem.inputs), collect=collect)
        seconds.append(time.process_time() - started)
    fastest = min(seconds[1:])
    return seconds[0] - fastest, fastest


def in_turns(name: str, settings: dict[str, Any], frames: int, turns: int) -> list[str]:
    """Compilation and run without and with emitters, each in new processes."""
    found: dict[int, list[tuple[float, float]]] = {sys.maxsize: [], 0: []}
    for limit in turns * list(found):
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            found[limit].append(pool.submit(measure, name, settings, frames, limit).result())
    return [f"{statistics.median(run[kind] for run in found[limit]):.3g}" for kind in (0, 1) for limit in found]


def main() -> None:
    options = arguments(__doc__, frames=64, turns=3)
    frames, turns = (2, 1) if options.quick else (options.frames, options.turns)
    rows = []
    for name, settings in CASES:
        listed = ", ".join(f"{setting} = {value:,}" for setting, value in settings.items())
        rows.append([f"{name} {listed}".strip(), *in_turns(name, settings, frames, turns)])
        print(*rows[-1], sep="\t", flush=True)
    columns = ["filter", "compilation without", "with", "run without", "with"]
    show(f"Processor seconds, {frames} frames", columns, rows)


if __name__ == "__main__":
    main()
