"""Models of many fields against answers that are computed without this library.

    python -m studies.independent_answers [--quick] [--models NAMES] [--particles 20000] [--output independent-answers]

Each model is filtered and smoothed. The answers are those of `studies.exact_posteriors`. The table has the largest error of a
filtered and of a smoothed mean of each quantity, in standard deviations of the exact posterior. It also has the error of the
log-evidence of all data, nats. The models are those of `studies.independent_models`. docs/validation/models.md is made from
studies/tables/independent_answers.csv.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from poseppl_papers.tables import Table

import poseppl
from benchmarks.timing import arguments, write_table
from poseppl.cli.console import start_jax
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from studies.exact_posteriors import Array
from studies.independent_models import CASES, Case

NAME = "independent_answers"
_COLUMNS = ("model", "held_against", "filter", "smoother", "filtered", "smoothed", "evidence")
_ABOUT = "Largest errors of filtered and smoothed means, posterior standard deviations, and of the log-evidence, nats."


def errors(case: Case, filter: str, smoother: str, particles: int) -> tuple[float, float, float]:
    """Largest errors of filtered and smoothed means, posterior standard deviations, and that of the log-evidence, nats."""
    frame = None if case.inputs is None else {name: values[0] for name, values in case.inputs.items()}
    compiled = case.programs.compile(frame)
    settings = {"num_particles": str(particles)} if "num_particles" in FILTERS[filter].settings else {}
    built = FILTERS[filter].build(compiled, settings)[0]
    chosen = {"num_trajectories": str(particles // 4)} if smoother == "backward-simulation" else {}
    tree = poseppl.infer(compiled, case.data, built, jax.random.key(1), case.inputs)
    smooth = SMOOTHERS[smoother].build(compiled, chosen)[0]
    smoothed = poseppl.smooth(tree, smooth, jax.random.key(2), case.inputs)
    evidence = float(tree["sample_stats/log_evidence"].sum()) - case.exact.evidence
    apart = [
        np.max(np.abs(mean_of(result, case.quantity) - mean) / np.maximum(deviation, 1e-2))
        for result, (mean, deviation) in ((tree, case.exact.filtered), (smoothed, case.exact.smoothed))
    ]
    return float(apart[0]), float(apart[1]), evidence


def mean_of(result: Any, name: str) -> Array:
    """Mean (T,) of a site, of one of finitely many values from their probabilities."""
    summary = result["summary"].dataset
    if f"{name}_mean" in summary:
        return np.asarray(summary[f"{name}_mean"].values, float)
    chances = summary[f"{name}_probability"]
    return np.asarray(chances.values @ chances[f"{name}_value"].values, float)


def main() -> None:
    """Print the errors and write them to OUTPUT."""
    options = arguments(__doc__, models=";".join(CASES), particles=20_000, output="independent-answers")
    start_jax()
    names: Sequence[str] = options.models.split(";")[: 2 if options.quick else None]
    table = Table(NAME, _COLUMNS, [], _ABOUT)
    for name in names:
        case = CASES[name]()
        for filter, smoother in case.algorithms:
            found = errors(case, filter, smoother, 2000 if options.quick else options.particles)
            table.rows.append((name, case.against, filter, smoother, *(f"{number:.2g}" for number in found)))
            print(*table.rows[-1], sep=" | ", flush=True)
    write_table(table, options.output, "1 of each model", "none")


if __name__ == "__main__":
    main()
