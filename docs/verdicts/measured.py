"""Numbers with their errors: read from tables, subtracted, and written as the pages have them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

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
        return self.spread / self.runs**0.5

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
    (row,) = records(table, **where)
    return Measured(row[column], row[f"{column}_sd"], row["runs"])


def records(table: Table, **where: Any) -> list[dict[str, Any]]:
    """Rows as dicts."""
    return [dict(zip(table.columns, row, strict=True)) for row in table.select(**where)]
