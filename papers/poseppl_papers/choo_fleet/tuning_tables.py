"""Tables of section 7.5: what a user looks at to tune the HMC filter, and the automatic choice."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from poseppl_papers.choo_fleet.tuning import TuningRuns
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.tables import Table


def tuning_tables(jobs: Sequence[TuningRuns], results: Results) -> list[Table]:
    """Rejection and inefficiency by epsilon and L, autocorrelation by lag, R-hat by update."""
    ordered = sorted(jobs, key=lambda job: job.num_leapfrog)
    mixing, correlation, burn_in = [], [], []
    for job in ordered:
        found = results[job.key]
        for index, step_size in enumerate(job.step_sizes):
            rejection = np.asarray(found["rejection"][index], float)
            tau, error = mean_and_error(np.log(found["tau"][index]).mean(-1))
            cost = float(np.exp(tau)), job.num_leapfrog * float(np.exp(tau)), error
            mixing.append((job.num_leapfrog, step_size, *mean_and_error(rejection), *cost))
            for lag, value in enumerate(found["autocorrelation"][index]):
                correlation.append((job.num_leapfrog, step_size, lag, float(value)))
            for offset, value in enumerate(found["rhat"][index]):
                burn_in.append((job.num_leapfrog, step_size, offset, float(value)))
    return [
        Table(
            "tuning",
            (
                "leapfrog",
                "step_size",
                "rejection",
                "rejection_standard_error",
                "tau",
                "gradients_per_draw",
                "log_standard_error",
            ),
            mixing,
            "Rejection rate, inefficiency factor (geometric mean over coordinates and runs), gradients an independent draw, "
            "and the standard error of the natural logarithm of both. They are nan where the chains of a run never moved.",
        ),
        Table(
            "autocorrelation",
            ("leapfrog", "step_size", "lag", "autocorrelation"),
            correlation,
            "Mean over coordinates and runs.",
        ),
        Table(
            "burn_in",
            ("leapfrog", "step_size", "burn_in", "rhat"),
            burn_in,
            "Largest R-hat over coordinates of the 16 updates after a burn-in, the median over runs.",
        ),
    ]


def choose(tables: Sequence[Table]) -> dict[str, Any]:
    """The automatic choice: the fewest gradients an independent draw, and the burn-in from which R-hat stays below 1.2.

    Settings whose rejection rate exceeds 30 % are left out: they mix by luck.
    """
    mixing, _, burn_in = tables
    rows = [row for row in mixing.rows if row[2] <= 0.3 and np.isfinite(row[5])]
    if not rows:
        return {}
    best = min(rows, key=lambda row: row[5])
    rhat = burn_in.column("rhat", leapfrog=best[0], step_size=best[1])
    above = np.flatnonzero(rhat > 1.2)
    settled = int(above[-1]) + 1 if len(above) else 0
    return {
        "leapfrog": best[0],
        "step_size": best[1],
        "rejection": best[2],
        "burn_in": settled,
        "is_settled": settled < len(rhat),
    }
