"""Numbers with their errors: read from tables, subtracted, and written as the pages have them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from poseppl.arrays import Floats
from poseppl_papers.experiment import verdict_of
from poseppl_papers.tables import Table

MATTERS = 0.1
"""The smallest difference that matters, as a share of the error it is compared with. Peursum calls 168 and 185 mm similar."""


class Interval(NamedTuple):
    """A mean and its reported interval; NaN if it is unknown, which decides nothing."""

    mean: float
    low: float
    high: float

    @classmethod
    def around(cls, mean: float, reach: float) -> Interval:
        """Reach to both sides of a mean."""
        return cls(mean, mean - reach, mean + reach)

    def clipped(self, least: float, most: float = math.inf) -> Interval:
        """The part between two values."""
        return Interval(self.mean, max(self.low, least), min(self.high, most))

    def text(self, spec: str = ".0f", unit: str = "") -> str:
        """As "3 mm (-2 to 8)", or "3 mm" where nothing is known of its error."""
        if not math.isfinite(self.high - self.low):
            return f"{self.mean:{spec}}{unit}"
        return f"{self.mean:{spec}}{unit} ({self.low:{spec}} to {self.high:{spec}})"

    def above(self, limit: float) -> str:
        """Verdict on the claim that the mean is above a limit."""
        return verdict_of(self.low > limit, self.high < limit)

    def below(self, limit: float) -> str:
        """Verdict on the claim that the mean is below a limit."""
        return verdict_of(self.high < limit, self.low > limit)

    def within(self, least: float, most: float) -> str:
        """Verdict on the claim that the mean is between two values."""
        return verdict_of(self.low >= least and self.high <= most, self.high < least or self.low > most)

    def agrees(self, published: float, bound: float) -> str:
        """Verdict on the claim that a difference is what a published one is: more than a bound to one side, or less than it.

        Args:
            published: The published difference.
            bound: The smallest difference that matters, chosen before the runs: two differences within it are alike.
        """
        if abs(published) <= bound:
            return self.within(-bound, bound)
        return self.above(bound) if published > 0 else self.below(-bound)


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

    @property
    def interval(self) -> Interval:
        """Two standard errors to both sides."""
        return Interval.around(self.mean, 2 * self.error)

    def text(self, digits: int = 0) -> str:
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


def measured(row: Mapping[str, Any], column: str) -> Measured:
    """A column of a row with its "_sd" and "runs"."""
    return Measured(row[column], row[f"{column}_sd"], row["runs"])


def find(table: Table, column: str, **where: Any) -> Measured:
    """The same of the one row whose columns have the given values."""
    (row,) = table.records(**where)
    return measured(row, column)


def mean_and_error(values: Floats) -> tuple[float, float]:
    """Mean over runs (R,) and its standard error, NaN for a single run."""
    return float(values.mean()), float(values.std(ddof=1) / len(values) ** 0.5) if len(values) > 1 else math.nan


def mean_interval(values: Sequence[float] | Floats) -> Interval:
    """Mean of runs, and Student's 95 % interval; infinite for a single run or none, a point where all are alike."""
    found = np.asarray(values, float)
    mean = float(found.mean()) if len(found) else np.nan
    if len(found) < 2:
        return Interval(mean, -np.inf, np.inf)
    half = float(stats.t.ppf(0.975, len(found) - 1) * found.std(ddof=1) / len(found) ** 0.5)
    return Interval.around(mean, half)
