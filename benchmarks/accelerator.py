"""Benefit of a GPU: wall seconds of many series, many particles and one body, on JAX's device.

    python -m benchmarks.accelerator [--quick] [--repetitions 3] [--output accelerator]

Run it once with the accelerator and once with JAX_PLATFORMS=cpu in the same folder: rows of another device are kept. The table
has the first run, which compiles, and the median of later ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.toys.linear_gaussian import linear_gaussian
from poseppl_papers.choo_fleet.systems import SIMULATED, noisy_points, pose_sequence, stage_of
from poseppl_papers.peursum.dimensionality import growth_sets
from poseppl_papers.tables import Table

import poseppl
from benchmarks.timing import arguments, interleave, show, write_table
from studies.kept_runs import read_runs

NAME = "accelerator"
_COLUMNS = ("device", "job", "first", "seconds")
_ABOUT = "Wall seconds of the first call, which compiles, and the median of the others."
Jobs = dict[str, Callable[[], Any]]


def device() -> str:
    """JAX's device."""
    found = jax.devices()[0]
    return f"{len(os.sched_getaffinity(0))} cores" if found.platform == "cpu" else found.device_kind


def series(quick: bool) -> Jobs:
    """Many series of a level in one dimension, filtered in one call."""
    number, frames = (20, 10) if quick else (1000, 200)
    model = linear_gaussian(1).compile()
    data = {"y": np.random.default_rng(0).normal(size=(number, frames, 1)).cumsum(1) * 0.3}
    filters = {"Kalman": poseppl.kalman_filter(model, 200), "particle, N = 1,000": poseppl.particle_filter(model, 1000)}
    key = jax.random.key(0)

    def job(filter: Any) -> Callable[[], Any]:
        return lambda: poseppl.infer_batch(model, data, filter, key, chunk=number)

    return {f"{number:,} series of {frames} frames, {name}": job(filter) for name, filter in filters.items()}


def particles(quick: bool) -> Jobs:
    """The bootstrap filter of one series."""
    frames = 10 if quick else 100
    posed = growth_sets(1, frames)
    data, key = jax.tree.map(lambda leaf: leaf[0], posed.observations), jax.random.key(0)

    def job(number: int) -> Callable[[], Any]:
        filter, collect = poseppl.particle_filter(posed.model, number), poseppl.collect_draws(posed.model, max_draws=100)
        return lambda: poseppl.run_filter(filter, key, data, posed.times, collect=collect).outputs

    numbers = (1000,) if quick else (10_000, 100_000, 1_000_000)
    return {f"bootstrap filter, N = {number:,}, {frames} frames": job(number) for number in numbers}


def bodies(quick: bool) -> Jobs:
    """The default tracker of the 28-DOF body that simulated motion moves, one camera."""
    most, frames = (2, 3) if quick else (400, 25)
    shown = slice(1, 1 + frames)
    stages = [stage_of(SIMULATED, "full_body", run) for run in range(most)]
    points = np.stack([noisy_points(stage, shown, run) for run, stage in enumerate(stages)])
    problem = pose_sequence(stages[0], shown, points[0])
    filter, key = poseppl.assumed_density_filter(problem.model), jax.random.key(0)

    def job(number: int) -> Callable[[], Any]:
        scales = jnp.broadcast_to(problem.inputs.step_scale, (number, *problem.inputs.step_scale.shape))
        inputs = problem.inputs._replace(step_scale=scales)
        return lambda: poseppl.infer_batch(
            problem.model, {"points": points[:number]}, filter, key, inputs, chunk=number, collect=problem.collector(20)
        )

    return {f"default tracker, {number} bodies of {frames} frames": job(number) for number in (1, most)}


def main() -> None:
    options = arguments(__doc__, repetitions=3, output="accelerator")
    jobs = {**series(options.quick), **particles(options.quick), **bodies(options.quick)}
    timings = interleave(jobs, 1 if options.quick else options.repetitions)
    rows = [row for row in read_runs(options.output / f"{NAME}.csv") if row[0] != device()]
    rows += [(device(), name, f"{first:.3g}", f"{median:.3g}") for name, (first, median) in timings.items()]
    show("Wall seconds", _COLUMNS, rows)
    write_table(Table(NAME, _COLUMNS, rows, _ABOUT), options.output, str(options.repetitions), "none")


if __name__ == "__main__":
    main()
