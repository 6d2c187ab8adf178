"""Detections by predictive checks in runs whose truth is known, for docs/validation/verdicts.md."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Callable, Mapping
from typing import Any

from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
Groups = dict[tuple[str, str], list[dict[str, Any]]]
"""Runs by model and filter."""
LEAST, MOST = 0.8, 0.87
"""Coverage below which a run ought to have an error, and above which it ought to have none."""
_STEPS = (0.0, 0.6, 0.7, LEAST, MOST, 1.0)
_HOLDS = {True: "holds", False: "does not hold"}


def checks(tables: Tables) -> str:
    """Coverage and errors found by model and filter, and whether the two goals hold."""
    rows = tables["predictive_checks"].records()
    single = grouped(rows, str)
    return f"{_table(rows)}\n\n{goal(rows, single, 'below')}\n{goal(rows, single, 'above')}"


def lost(tables: Tables) -> str:
    """The same for simulated motion, and errors found by coverage."""
    rows = tables["simulated_checks"].records()
    findings = [
        f"{sum(row['errors'] != 'none' for row in part)} of the {len(part)} between {100 * least:.0f} and {100 * most:.0f} %"
        for least, most in itertools.pairwise(_STEPS)
        if (part := [row for row in rows if least <= row["coverage"] < most])
    ]
    mean = mean_interval([100 * row["coverage"] for row in rows]).text(".1f")
    return f"{_table(rows)}\n\nThe mean coverage is {mean} %. An error is found in {', '.join(findings)}."


def _table(rows: list[dict[str, Any]]) -> str:
    columns = (
        *("model", "filter", "runs", "coverage of 90 % intervals, %", "variance of errors over the claimed one"),
        *("errors found", "missed of those below 80 %", "accused of those above 87 %"),
    )
    return markdown(columns, [[*key, *_summed(group)] for key, group in grouped(rows, _kind).items()])


def grouped(rows: list[dict[str, Any]], name: Callable[[str], str]) -> Groups:
    """Runs by the name of their model, and by filter."""
    groups: Groups = {}
    for row in rows:
        groups.setdefault((name(row["model"]), row["filter"]), []).append(row)
    return groups


def _kind(model: str) -> str:
    """The model, and all recordings that so many cameras see as one."""
    name, _, cameras = model.rpartition(", ")
    return f"recordings, {cameras}" if "camera" in cameras and name != "built-in walk" else model


def missed(row: Mapping[str, Any]) -> bool:
    """Whether intervals are too narrow and nothing says so."""
    return row["coverage"] < LEAST and row["errors"] == "none"


def accused(row: Mapping[str, Any]) -> bool:
    """Whether intervals are right and an error says that something is wrong."""
    return row["coverage"] > MOST and row["errors"] != "none"


def _summed(group: list[dict[str, Any]]) -> list[str]:
    low = [row for row in group if row["coverage"] < LEAST]
    high = [row for row in group if row["coverage"] > MOST]
    return [
        str(len(group)),
        _span([100 * row["coverage"] for row in group], 0),
        _span([row["inflation"] for row in group], 2),
        str(sum(row["errors"] != "none" for row in group)),
        f"{sum(map(missed, low))} of {len(low)}" if low else "",
        f"{sum(map(accused, high))} of {len(high)}" if high else "",
    ]


def _span(values: list[float], digits: int) -> str:
    """Median, and the least and the largest."""
    if len(values) == 1:
        return f"{values[0]:.{digits}f}"
    return f"{statistics.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


def goal(rows: list[dict[str, Any]], groups: Groups, side: str) -> str:
    """Whether no run is missed, or none accused, and which are."""
    below = side == "below"
    fault = missed if below else accused
    of = sum(row["coverage"] < LEAST if below else row["coverage"] > MOST for row in rows)
    number = sum(map(fault, rows))
    where = [
        f"{model} with {name} ({sum(map(fault, group))})" for (model, name), group in groups.items() if any(map(fault, group))
    ]
    what = "Every run below 80 % has an error" if below else "No run above 87 % has one"
    named = f": {', '.join(where)}" if where else ""
    verb = "missed" if below else "accused"
    return f"- {what}: {_HOLDS[number == 0]}; {number} of {of} are {verb}{named}."
