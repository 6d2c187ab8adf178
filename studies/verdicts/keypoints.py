"""How far joints from two cameras' keypoints are from those of four, for docs/validation/keypoints.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
DEFAULT = "smoother, autocorrelated errors"
"""The method whose answer users get."""
_GOALS = {
    "median": ((0.0, 14.0), (0.0, 22.0)),
    "percentile_95": ((0.0, 35.0), (0.0, 60.0)),
    "coverage_50": ((0.45, 0.55),) * 2,
    "coverage_90": ((0.85, 0.95),) * 2,
    "ece": ((0.0, 0.05),) * 2,
}
"""Between what a column has to be for each of the pairs."""
_PAIRS = ("1-4", "2-4")
_COLUMNS = {
    "median": ("median", ".1f"),
    "percentile_95": ("95th percentile", ".1f"),
    "coverage_50": ("coverage of 50 % intervals", ".1%"),
    "coverage_90": ("coverage of 90 % intervals", ".1%"),
    "ece": ("ECE", ".3f"),
}


_FRAMES, _RATE, _COMPILING = 100, 60.0, 15.0
"""Frames of the recording; frames a second and seconds of compilation that are asked for."""
_STRAIGHT = "smoother without a filter"
_DEFAULT_PARTS = ("filter, assumed density", DEFAULT)
_FASTEST_PARTS = ("filter, Kalman", "smoother, Rauch-Tung-Striebel")


def keypoints(tables: Tables) -> str:
    """Errors and coverage by cameras and method, and which of the goals the default answer reaches with two cameras."""
    rows = tables["keypoints"].records()
    cells = [[str(row["cameras"]).replace("-", ", "), row["method"], *(_shown(row, name) for name in _COLUMNS)] for row in rows]
    default = [row for pair in _PAIRS for row in rows if (row["cameras"], row["method"]) == (pair, DEFAULT)]
    table = markdown(("cameras", "method", *(title for title, _ in _COLUMNS.values())), cells)
    alone = [row["coverage_90"] for row in rows if "-" not in str(row["cameras"])]
    low, high = min(alone), max(alone)
    goal = _holds(low >= 0.85 and high <= 0.95)
    told = f"One camera, coverage of 90 % intervals between 85 and 95 %: {goal} ({low:.1%} to {high:.1%})."
    head = "Goals of the last, the default, with two cameras:"
    return "\n".join([table, "", told, "", head, "", *(_verdict(name, default) for name in _GOALS)])


def _shown(row: Mapping[str, Any], name: str) -> str:
    return "" if math.isnan(row[name]) else format(row[name], _COLUMNS[name][1])


def _verdict(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Whether a column is within its goals in the rows of both pairs."""
    title, form = _COLUMNS[name]
    within = all(low <= row[name] <= high for row, (low, high) in zip(rows, _GOALS[name], strict=True))
    goals = " and ".join(dict.fromkeys(f"{low:{form}} to {high:{form}}" for low, high in _GOALS[name]))
    found = " and ".join(_shown(row, name) for row in rows)
    return f"- {title}, {goals}: {_holds(within)} ({found})."


def speed(tables: Tables) -> str:
    """Seconds by part, and which of the goals the default and the fastest pair of a filter and a smoother reach.

    In a table of a time before recordings were smoothed without a filter, the default is a pair, too.
    """
    rows = {str(row["part"]): row for row in tables["keypoint_speed"].records()}
    columns = ("part", "first run, s", "later run, s", "error, mm", "95th percentile")
    numbers = ("first_seconds", "seconds", "error", "error_95")
    cells = [[part, *("" if math.isnan(row[name]) else f"{row[name]:.1f}" for name in numbers)] for part, row in rows.items()]
    told = []
    default = ("default smoother", (_STRAIGHT,)) if _STRAIGHT in rows else ("default filter and smoother", _DEFAULT_PARTS)
    for name, parts in (default, ("fastest filter and smoother", _FASTEST_PARTS)):
        first, later = (sum(rows[part][column] for part in parts) for column in ("first_seconds", "seconds"))
        rate, compiling = _FRAMES / later, first - later
        told.append(
            f"- The {name}, {_RATE:.0f} frames a second: {_holds(rate >= _RATE)} ({rate:.1f}); compiled in "
            f"{_COMPILING:.0f} s: {_holds(compiling <= _COMPILING)} ({compiling:.0f} s)."
        )
    return "\n".join([markdown(columns, cells), "", *told])


def _holds(holds: bool) -> str:
    return "holds" if holds else "does not hold"
