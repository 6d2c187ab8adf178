"""Numbers with their errors: read from tables, subtracted, and written as the pages have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from poseppl.arrays import Floats
from poseppl.experiments.tables import Table


class Measured(NamedTuple):
    """A mean over runs.

    Attributes:
        mean: The mean.
        spread: Standard deviation over runs; NaN for one run.
        runs: How many.
    """

    mean: float
    spread: float
    runs: int

    @property
    def error(self) -> float:
        """Standard error of the mean."""
        return self.spread / math.sqrt(self.runs)

    def told(self, digits: int = 0) -> str:
        """As "139 +- 11", with the standard deviation over runs."""
        spread = "" if math.isnan(self.spread) else f" +- {self.spread:.{digits}f}"
        return f"{self.mean:.{digits}f}{spread}"


def difference(one: Measured, other: Measured) -> tuple[float, float]:
    """One less the other, and its standard error."""
    return one.mean - other.mean, math.hypot(one.error, other.error)


def over_runs(values: Sequence[float]) -> Measured:
    """Sum up single runs."""
    count, mean = len(values), sum(values) / len(values)
    spread = math.sqrt(sum((value - mean) ** 2 for value in values) / (count - 1)) if count > 1 else math.nan
    return Measured(mean, spread, count)


def find(table: Table, column: str, **where: Any) -> Measured:
    """The one row whose columns have the given values: a column with its "_sd" and "runs"."""
    (row,) = table.records(**where)
    return Measured(row[column], row[f"{column}_sd"], row["runs"])


def mean_interval(values: Sequence[float] | Floats) -> tuple[float, float, float]:
    """Mean of runs, and Student's 95 % interval; infinite for a single run or none, a point where all are alike."""
    found = np.asarray(values, float)
    mean = float(found.mean()) if len(found) else np.nan
    if len(found) < 2:
        return mean, -np.inf, np.inf
    half = float(stats.t.ppf(0.975, len(found) - 1) * found.std(ddof=1) / len(found) ** 0.5)
    return mean, mean - half, mean + half
