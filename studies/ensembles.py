"""Filters of a chaotic state in high dimension: Lorenz's model of 1996, half of its coordinates seen, 100 frames.

    python -m studies.ensembles [--quick] [--dimensions 40,400] [--spreads 1] [--filters NAMES] [--seeds 3]
        [--frames 100] [--output ensembles]

The table has, for each filter, the root mean square error of its means over frames and coordinates, and the coverage of 90 %
intervals. It also says whether verdicts that need no truth find an error, and has the seconds of a run without compilation.
Each seed simulates data from the model, with noise 1; the first state is known within SPREAD. Runs in OUTPUT/ensembles.csv are
reused. Separate NAMES by semicolons. The tapers of ensemble filters reach 20 coordinates to either side, of which half are
seen.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
from poseppl_models.toys.lorenz96 import lorenz96
from poseppl_papers.tables import Table, write_csv

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.filters import (
    Filter,
    assumed_density_filter,
    ensemble_kalman_filter,
    guided_filter,
    kalman_filter,
    tempered_filter,
)
from poseppl.gaussians.localisation import Localisation, localise_by_position
from poseppl.program import CompiledModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.outcome import result_of_run
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.run import run_filter
from poseppl.runs.simulation import simulate
from studies.kept_runs import read_runs
from studies.predictive_checks import judge, kinds

RADIUS = 20.0
LARGE = 100
"""Dimension from which on only Gaussian filters run."""
_COLUMNS = ("dimension", "spread", "filter", "seed", "frames", "error", "coverage", "verdict", "seconds")
_KEY = 5
_ABOUT = "Error of means, share of the truth in 90 % intervals, kinds of errors among verdicts without truth, seconds of a run."


def tapers(model: CompiledModel) -> Localisation:
    """Gaspari and Cohn's on the circle of coordinates."""
    places = np.arange(model.dimension)
    return localise_by_position(model, {"x": places, "y": places[::2]}, RADIUS, period=model.dimension)


FILTERS: Mapping[str, Callable[[CompiledModel], Filter]] = {
    "extended Kalman": kalman_filter,
    "unscented Kalman": lambda model: kalman_filter(model, linearisation="unscented"),
    "ensemble Kalman, 100, no tapers": ensemble_kalman_filter,
    "ensemble Kalman, 40": lambda model: ensemble_kalman_filter(model, 40, localisation=tapers(model), relaxation=0.2),
    "ensemble Kalman, 100": lambda model: ensemble_kalman_filter(model, localisation=tapers(model), relaxation=0.2),
    "ensemble Kalman, 100, adaptive": lambda model: ensemble_kalman_filter(model, localisation=tapers(model), adaptive=True),
    "ensemble Kalman, 100, stochastic": lambda model: ensemble_kalman_filter(
        model, form="stochastic", localisation=tapers(model), relaxation=0.2
    ),
    "assumed density": assumed_density_filter,
    "auxiliary, 2,000": lambda model: guided_filter(model, 2000, auxiliary=True),
    "tempered, 500": lambda model: tempered_filter(model, 500),
}


def run_once(model: CompiledModel, built: tuple[Any, Any, Any], seed: int, frames: int) -> tuple[str, ...]:
    """Error, coverage, verdict and seconds of a run; the first of a filter compiles, and is made twice."""
    filter, collect, predict = built
    truth, values = simulate(model, jax.random.key(1000 + seed), frames, None)
    observations = model.observe(jax.tree.map(np.asarray, values))
    for _ in range(2 if seed == 0 else 1):
        started = time.perf_counter()
        run = run_filter(filter, jax.random.key(seed), observations, collect=collect, predict=predict)
        seconds = time.perf_counter() - started
    tree = result_of_run(run, model, observations, truth=truth)
    judged = judge(tree)
    error = np.sqrt(np.mean((tree["summary"].dataset["state_mean"].values - np.asarray(truth)) ** 2))
    return f"{error:.3g}", f"{judged.coverage:.3g}", kinds(judged.errors), f"{seconds:.2g}"


def summary(table: Table) -> list[list[str]]:
    """Means over seeds, of each dimension and filter."""
    rows = []
    for case in dict.fromkeys(row[:3] for row in table.rows):
        runs = [row[_KEY:] for row in table.rows if row[:3] == case]
        error, coverage, seconds = (np.array([float(run[i]) for run in runs]) for i in (0, 1, 3))
        red = sum(run[2] != "none" for run in runs)
        low = int((coverage < 0.8).sum())
        rows.append(
            [
                *case,
                f"{error.mean():.2f} ({error.min():.2f} to {error.max():.2f})",
                f"{coverage.mean():.0%}",
                f"{red} of {len(runs)}",
                f"{low} of {len(runs)}",
                f"{np.median(seconds):.2g}",
            ]
        )
    return rows


def main() -> None:
    options = arguments(__doc__, dimensions="40,400", spreads="1", filters="", seeds=3, frames=100, output="ensembles")
    start_jax()
    output = options.output
    seeds, frames = (1, 5) if options.quick else (options.seeds, options.frames)
    table = Table("ensembles", _COLUMNS, read_runs(output / "ensembles.csv"), _ABOUT)
    for dimension, spread in itertools.product(map(int, options.dimensions.split(",")), options.spreads.split(",")):
        model = lorenz96(dimension, initial_spread=float(spread)).compile()
        collect, predict = collect_draws(model, max_draws=20), predictive_checks(model)
        names = [name for name in options.filters.split(";") if name] or list(FILTERS)
        for name in names if dimension < LARGE else [name for name in names if "Kalman" in name]:
            built = FILTERS[name](model), collect, predict
            for seed in range(seeds):
                key = (str(dimension), spread, name, str(seed), str(frames))
                if key in {row[:_KEY] for row in table.rows}:
                    continue
                table.rows.append((*key, *run_once(model, built, seed, frames)))
                write_csv(table, output)
                print(*table.rows[-1], sep="\t", flush=True)
    show("", ["d", "spread", "filter", "error", "90 % hold", "told", "below 80 %", "s"], summary(table))


if __name__ == "__main__":
    main()
