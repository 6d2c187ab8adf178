"""How far off joints are that one camera sees, and whether intervals hold, for docs/keypoints.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from scipy.stats import t as student

from poseppl.experiments.measured import over_runs
from poseppl.experiments.tables import Table, markdown

Tables = Mapping[str, Table]
Rows = list[Mapping[str, Any]]
LEAST, MOST = 85.0, 95.0
"""Percent that 90 % intervals are to hold."""
_COLUMNS = ("walk", "method", "error, mm", "farther away than the truth, mm", "50 % intervals hold, %", "90 %")


def one_camera(tables: Tables) -> str:
    """Means over recordings with 95 % intervals by Student's t, and whether the intervals hold what they should."""
    groups: dict[tuple[str, str], Rows] = {}
    for row in tables["one_camera"].records():
        groups.setdefault((row["walk"], row["method"]), []).append(row)
    columns = (("error", 1.0), ("farther", 1.0), ("coverage_50", 100.0), ("coverage_90", 100.0))
    cells = [
        [*names, *("{:.0f} ± {:.0f}".format(*interval(rows, column, scale)) for column, scale in columns)]
        for names, rows in groups.items()
    ]
    goals = [
        f"- 90 % intervals hold {LEAST:.0f} to {MOST:.0f} %, {method}, {walk} walk: "
        f"{_verdict(*interval(rows, 'coverage_90', 100.0))}."
        for (walk, method), rows in groups.items()
    ]
    less = [
        f"- Mean-reverting less fixed, {method}: {{:+.0f}} ± {{:.0f}} mm.".format(
            *interval(paired(groups["mean-reverting", method], groups["fixed", method]), "error")
        )
        for method in dict.fromkeys(method for _, method in groups)
    ]
    return f"{markdown(_COLUMNS, cells)}\n\n" + "\n".join(goals + less)


def paired(ones: Rows, others: Rows) -> Rows:
    """Differences of errors on the same recordings."""
    there = {row["recording"]: row["error"] for row in others}
    return [{"error": row["error"] - there[row["recording"]]} for row in ones]


def interval(rows: Rows, column: str, scale: float = 1.0) -> tuple[float, float]:
    """Mean of a column, scaled, and half of its 95 % interval."""
    found = over_runs([scale * row[column] for row in rows])
    return found.mean, float(student.ppf(0.975, found.runs - 1)) * found.error


def _verdict(mean: float, reach: float) -> str:
    if mean + reach < LEAST or mean - reach > MOST:
        return "does not hold"
    return "holds" if mean - reach >= LEAST and mean + reach <= MOST else "undecided"
