"""Which filter for which model by trials, for docs/validation/filters.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
_FAULTS = {"missed": "below", "accused": "above"}
"""Columns of runs that are judged wrongly, and of those that could be."""
_COLUMNS = (
    *("model", "filter", "seeds", "error, least is 1", "coverage of 90 % intervals", "s", "red"),
    *("missed of those below 80 %", "accused of those above 87 %"),
)


def choosing(tables: Tables) -> str:
    """Errors over a model's least, coverage, seconds and verdicts, best first; which filters refuse which, or did not run."""
    rows = tables["choosing"].records()
    filters = dict.fromkeys(row["filter"] for row in rows)
    shown, refused, missing = [], [], []
    for model in dict.fromkeys(row["model"] for row in rows):
        mine = [row for row in rows if row["model"] == model]
        ran = sorted((row for row in mine if not row["refused"]), key=lambda row: float(row["error"]))
        shown += [_cells(row, float(ran[0]["error"])) for row in ran]
        refused += _pairs(model, [row["filter"] for row in mine if row["refused"]])
        missing += _pairs(model, [name for name in filters if name not in {row["filter"] for row in mine}])
    excluded = {"Refused": refused, "Not run": missing}
    ends = (f"{what}: {'; '.join(pairs)}." for what, pairs in excluded.items() if pairs)
    return "\n\n".join([markdown(_COLUMNS, shown), *ends])


def _pairs(model: str, filters: list[str]) -> list[str]:
    return [f"{model} by {', '.join(filters)}"] if filters else []


def _cells(row: Mapping[str, Any], least: float) -> list[str]:
    return [
        row["model"],
        row["filter"],
        str(int(row["seeds"])),
        f"{float(row['error']) / least:.2f}",
        _share(float(row["coverage"]), row["coverage_se"]),
        f"{float(row['seconds']):.2g}",
        str(int(row["red"])),
        *(f"{int(row[fault])} of {int(row[of])}" if row[of] else "" for fault, of in _FAULTS.items()),
    ]


def _share(coverage: float, error: Any) -> str:
    """In percent, where there are real coordinates, with its standard error over sequences where that is known."""
    if math.isnan(coverage):
        return ""
    known = error != "" and not math.isnan(error)
    return f"{100 * coverage:.0f} ± {100 * error:.0f} %" if known else f"{100 * coverage:.0f} %"
