"""Are the trackers calibrated? Coverage of their intervals and joint error, over sequences that the model itself simulates.

    python -m studies.calibration [--quick] [--sequences 24] [--frames 25] [--trackers assumed] [--scale 1]

Each sequence of the 28-DOF body is seen by one camera at 5 m. Coverage is the share of the true coordinates inside the central
50, 80 and 90 % intervals, its standard error that over sequences; the error is the mean distance of the 17 joints' posterior
means from the truth. `--scale` multiplies all standard deviations, of steps, start and noise: the smaller, the nearer to a
linear model. `--trackers` takes those whose names hold one of these words, separated by commas.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from benchmarks.simulated import Problem, build_problem, draw_sequence
from benchmarks.timing import arguments, show
from poseppl.diagnostics import coverage
from poseppl.diagnostics.calibration import Coverage, between
from poseppl.filters import Filter, assumed_density_filter, hmc_filter, particle_filter
from poseppl.filters.assumed_density import TRACKER
from poseppl.kernels import HMCSettings
from poseppl.motion.geometry import marker_positions
from poseppl.motion.measures import joint_error
from poseppl.program import CompiledModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import Constant, run_filter

LEVELS = (0.5, 0.8, 0.9)
BOUNDS = sorted({round((1 + sign * level) / 2, 6) for level in LEVELS for sign in (-1, 1)})
PAPER = HMCSettings(num_updates=32, num_leapfrog=40, num_warmup=6)

TRACKERS: Mapping[str, Callable[[CompiledModel], Filter]] = {
    "particle (100,000)": lambda model: particle_filter(model, 100_000),
    "hmc (10 chains, L 40, R 32)": lambda model: hmc_filter(model, 10, PAPER),
    "assumed-density (default)": assumed_density_filter,
    "assumed-density (120 chains, R 60, 80 starts)": lambda model: assumed_density_filter(
        model, 120, TRACKER._replace(num_updates=60, num_warmup=10), num_starts=80
    ),
}


class Study(NamedTuple):
    """Results of a tracker.

    Attributes:
        coverages: One for each of LEVELS.
        errors: Mean joint error of each sequence, mm.
        rates: Frames a second in each sequence but the first, whose run compiles; the collector is included.
    """

    coverages: list[Coverage]
    errors: np.ndarray
    rates: np.ndarray


def study(tracker: Filter, problem: Problem, seeds: Sequence[int], num_frames: int) -> Study:
    """Track one simulated sequence for each seed."""
    collect = collect_draws(problem.model, max_draws=1, mean_only=("markers",), quantiles=BOUNDS)
    inputs = jax.tree.map(Constant, problem.inputs)
    inside: dict[float, list[np.ndarray]] = {level: [] for level in LEVELS}
    errors, rates = [], []
    for seed in seeds:
        truth, observations = draw_sequence(problem, seed, num_frames)
        run = run_filter(tracker, jax.random.key(10_000 + seed), observations, inputs, collect=collect, chunk=num_frames)
        summary = run.outputs.summary
        for level, hits in inside.items():
            low, high = (BOUNDS.index(round((1 + sign * level) / 2, 6)) for sign in (-1, 1))
            quantiles = summary["state_quantile"]
            hits.append(between(quantiles[:, low], quantiles[:, high], np.asarray(truth)))
        markers = jax.vmap(partial(marker_positions, problem.body.tree))(truth)
        errors.append(joint_error(summary["markers_mean"], markers).absolute.mean())
        rates.append(num_frames / run.wall_seconds)
    return Study([coverage(hits, level) for level, hits in inside.items()], np.array(errors), np.array(rates[1:] or rates))


def main() -> None:
    options = arguments(__doc__, sequences=24, frames=25, trackers="", scale=1.0)
    count, frames = (2, 3) if options.quick else (options.sequences, options.frames)
    problem = build_problem(options.scale)
    rows = []
    asked = {name: TRACKERS[name] for name in TRACKERS if any(word in name for word in options.trackers.split(","))}
    for name, build in asked.items():
        found = study(build(problem.model), problem, range(count), frames)
        covered = [f"{100 * one.estimate:.1f} ± {100 * one.standard_error:.1f}" for one in found.coverages]
        spread = found.errors.std(ddof=1) / np.sqrt(count)
        error = f"{found.errors.mean():.1f} ± {spread:.1f}"
        rows.append([name, *covered, error, f"{np.median(found.errors):.1f}", f"{np.median(found.rates):.1f}"])
        show(
            f"{count} sequences of {frames} frames, ± one standard error over sequences",
            ["tracker", *(f"in {100 * level:.0f} %" for level in LEVELS), "error mm", "median mm", "frames/s"],
            rows,
        )


if __name__ == "__main__":
    main()
