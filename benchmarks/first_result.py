"""How long the first result of a one-dimensional model takes, and how much of it is compilation.

    python -m benchmarks.first_result [--quick] [--frames 50] [--turns 3] [--levels] [--checks]
        [--output first-results]

The model is a mean-reverting random walk seen with noise. Processor seconds of a new process without a compile cache, after the
imports (including those of xarray's first dataset): the model, a filter at its defaults (10,000 particles) or of 1,000
particles, and `infer`; `infer` with a second filter on the same model; and the first one again, which compiles nothing. The
table has the least over turns, since other work on the machine only adds. --checks adds predictive checks to all results.
--levels times a later run of 1,000 frames at each of LLVM's levels of optimisation instead.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import jax
import numpy as np
import numpyro
import numpyro.distributions as dist
import xarray as xr
from poseppl_papers.tables import Table

from benchmarks.timing import arguments, show, without_compile_cache, write_table
from poseppl import compilation, filters
from poseppl.program import StateSpaceModel
from poseppl.runs.infer import infer
from poseppl.runs.predictive import predictive_checks

SMALL = "particle, N = 1,000"
CASES = (("particle", "kalman"), (SMALL, "kalman"), ("hmc", "kalman"), ("kalman", SMALL), ("kalman", "particle"))
LEVELS = (0, 1, 2, 3)
NAME = "first_results"
_COLUMNS = ("first", "second", "first_result", "second_filter", "again")
_ABOUT = (
    "Processor seconds of the first result of a filter, of a second filter's on the same model, and of the first one's again."
)


def initial(params: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(0.0, 2.0))


def transition(params: Any, state: Any, inputs: Any) -> None:
    numpyro.sample("x", dist.Normal(0.9 * state["x"], 1.0))


def observation(params: Any, state: Any, inputs: Any) -> None:
    numpyro.sample("y", dist.Normal(state["x"], 1.0))


def built(name: str, model: Any) -> Any:
    return filters.particle_filter(model, 1000) if name == SMALL else getattr(filters, f"{name}_filter")(model)


def measure(first: str, second: str, frames: int, checks: bool) -> list[float]:
    """Processor seconds of the first result, of the second filter's, and of the first filter's again."""
    without_compile_cache()
    xr.Dataset({"y": ("frame", np.zeros(2))})
    data = {"y": np.random.default_rng(0).normal(size=frames)}
    seconds, model = [], None
    for name in (first, second, first):
        started = time.process_time()
        model = model or StateSpaceModel(initial, transition, observation).compile()
        predict = predictive_checks(model) if checks else None
        infer(model, data, built(name, model), jax.random.key(0), predict=predict)
        seconds.append(time.process_time() - started)
    return seconds


def measure_level(name: str, level: int, frames: int) -> list[float]:
    """Processor seconds of later runs, the least of five, where all programs are compiled at a level."""
    compilation._compiled = lambda lowered, options: lowered.compile(  # type: ignore[assignment]
        compiler_options=options | {"xla_backend_optimization_level": level}
    )
    data = {"y": np.random.default_rng(0).normal(size=frames)}
    model = StateSpaceModel(initial, transition, observation).compile()
    seconds = []
    for _ in range(6):
        started = time.process_time()
        infer(model, data, built(name, model), jax.random.key(0))
        seconds.append(time.process_time() - started)
    return [min(seconds[1:])]


def in_turns(turns: int, function: Any, *given: Any) -> list[float]:
    """The least of what a function measures in new processes."""
    found = []
    for _ in range(turns):
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            found.append(pool.submit(function, *given).result())
    return [min(column) for column in zip(*found, strict=True)]


def main() -> None:
    options = arguments(__doc__, frames=50, turns=3, levels=False, checks=False, output="first-results")
    turns, cases = (1, CASES[:1]) if options.quick else (options.turns, CASES)
    if options.levels:
        rows = [
            [first, *(f"{in_turns(turns, measure_level, first, level, 1000)[0]:.2f}" for level in LEVELS)] for first, _ in cases
        ]
        show("Processor seconds of 1,000 frames", ["filter", *(f"level {level}" for level in LEVELS)], rows)
        return
    measured = [(*case, *in_turns(turns, measure, *case, options.frames, options.checks)) for case in cases]
    if not options.checks:
        write_table(
            Table(NAME, _COLUMNS, measured, _ABOUT),
            options.output,
            str(turns),
            "none",
            "least of the runs, on a machine that ran other work",
        )
    rows = [[*row[:2], *(f"{seconds:.2f}" for seconds in row[2:])] for row in measured]
    show("Processor seconds", ["first filter", "second", "first result", "second filter", "first filter again"], rows)


if __name__ == "__main__":
    main()
