"""Overconfidence that predictions of the data do not show, found by another filter on the same data.

    python -m studies.blind_spots [--quick] [--models NAMES] [--filters NAMES] [--seeds 10] [--frames 60]

Runs are those of choosing.py. The table has two coverages of 90 % intervals, means over seeds with standard errors: of the
truth, and of a particle filter's draws (poseppl.diagnostics.reference_coverage). It counts the runs whose predictions of the
data are an error, and those that contain fewer than 84 % of the particle filter's draws. Separate NAMES by semicolons.
"""

from __future__ import annotations

import jax
import numpy as np
import xarray as xr

from benchmarks.timing import arguments, show
from poseppl.cli.console import start_jax
from poseppl.diagnostics import reference_coverage
from studies.choosing import Trial, coverage_of, filtered
from studies.predictive_checks import judge, kinds

FILTERS = "kalman;kalman, 4 iterations;ensemble-kalman;hmc"
TOO_FEW = 0.84
"""Share of the particle filter's draws below which intervals are called too narrow."""


def main() -> None:
    options = arguments(__doc__, models="bearings only;growth", filters=FILTERS, seeds=10, frames=60)
    start_jax()
    seeds, frames = (2, 5) if options.quick else (options.seeds, options.frames)
    for model in options.models.split(";"):
        references = [filtered(Trial(model, "particle", seed, frames)) for seed in range(seeds)]
        rows = [_row(model, name, frames, references) for name in options.filters.split(";")]
        show(model, ["filter", "truth, %", "particles, %", "predictions red", "too narrow for the particles"], rows)
        jax.clear_caches()


def _row(model: str, name: str, frames: int, references: list[xr.DataTree]) -> list[str]:
    trees = [filtered(Trial(model, name, seed, frames)) for seed in range(len(references))]
    compared = [reference_coverage(*pair).estimate for pair in zip(trees, references, strict=True)]
    red = sum("prediction" in kinds(judge(tree).errors) for tree in trees)
    shares = [coverage_of(tree) for tree in trees], compared
    cells = [f"{100 * np.mean(each):.0f} ± {100 * np.std(each, ddof=1) / np.sqrt(len(each)):.0f}" for each in shares]
    counts = [f"{count} of {len(trees)}" for count in (red, sum(share < TOO_FEW for share in compared))]
    print(model, name, *cells, *counts, sep="\t", flush=True)
    return [name, *cells, *counts]


if __name__ == "__main__":
    main()
