"""The default filter for markers, by errors, coverage and speed on recordings, for docs/validation/motion.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import fmean, median, stdev
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
FIRST = "kalman"
_COLUMNS = (
    *("cameras", "filter", "recordings", "runs", "mean joint error, mm", "less kalman's", "coverage of 90 % intervals, %"),
    *("recordings below 80 %", "frames a second"),
)


def default_filter(tables: Tables) -> str:
    """One row for each number of cameras and filter; recordings are the units of means and 95 % intervals."""
    rows = tables["default_filter"].records()
    cases = dict.fromkeys((row["cameras"], row["filter"]) for row in rows)
    return markdown(_COLUMNS, [cells_of(rows, *case) for case in sorted(cases, key=lambda case: (case[0], case[1] != FIRST))])


def cells_of(rows: list[dict[str, Any]], cameras: int, filter: str) -> list[str]:
    """A row of the table."""
    mine = [row for row in rows if (row["cameras"], row["filter"]) == (cameras, filter)]
    error, base = (_by_recording(rows, cameras, name, "error") for name in (filter, FIRST))
    coverage = _by_recording(rows, cameras, filter, "coverage")
    apart = [error[name] - base[name] for name in error]
    return [
        str(cameras),
        filter,
        str(len(error)),
        str(len(mine)),
        _interval(list(error.values())),
        "" if filter == FIRST else _interval(apart),
        _interval([100 * share for share in coverage.values()]),
        str(sum(share < 0.8 for share in coverage.values())),
        f"{median(row['frames_per_second'] for row in mine):.0f}",
    ]


def _by_recording(rows: list[dict[str, Any]], cameras: int, filter: str, column: str) -> dict[str, float]:
    """A column's mean over the seeds of each recording."""
    mine = [row for row in rows if (row["cameras"], row["filter"]) == (cameras, filter)]
    names = dict.fromkeys(row["recording"] for row in mine)
    return {name: fmean(row[column] for row in mine if row["recording"] == name) for name in names}


def _interval(values: list[float]) -> str:
    """A mean with its 95 % interval."""
    reach = 1.96 * stdev(values) / math.sqrt(len(values))
    return f"{fmean(values):.1f} ({fmean(values) - reach:.1f} to {fmean(values) + reach:.1f})"
