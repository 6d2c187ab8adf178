"""Errors of joints that one camera sees, and coverage, for docs/validation/keypoints.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.measured import over_runs
from poseppl_papers.tables import Table, markdown
from scipy.stats import t as student

Tables = Mapping[str, Table]
Rows = list[Mapping[str, Any]]
LEAST, MOST = 85.0, 95.0
"""Percent that 90 % intervals are to hold."""
USUAL, BEFORE = ("beside", "mean-reverting", "assumed-density"), ("body", "fixed", "laplace")
"""Noise, walk and method as ``poseppl track keypoints`` has them of one camera, and as without them."""
_COLUMNS = ("noise", "walk", "method", "error, mm", "farther away than the truth, mm", "coverage of 50 % intervals, %", "90 %")
_NUMBERS = (("error", 1.0), ("farther", 1.0), ("coverage_50", 100.0), ("coverage_90", 100.0))


def one_camera(tables: Tables) -> str:
    """Means over recordings with 95 % intervals by Student's t, and whether the coverage is right."""
    groups: dict[tuple[str, ...], Rows] = {}
    for row in tables["one_camera"].records():
        groups.setdefault((row["noise"], row["walk"], row["method"]), []).append(row)
    means = {names: of_recordings(rows) for names, rows in groups.items()}
    cells = [
        [*names, *("{:.0f} ± {:.0f}".format(*interval(rows, *column)) for column in _NUMBERS)] for names, rows in means.items()
    ]
    goals = [
        f"- coverage of 90 % intervals is {LEAST:.0f} to {MOST:.0f} %, {method}: "
        f"{_verdict(*interval(rows, 'coverage_90', 100.0))}."
        for (noise, walk, method), rows in means.items()
        if (noise, walk) == USUAL[:2]
    ]
    less = "- {}, {} and {} less {}, {} and {}: {:+.0f} ± {:.0f} mm.".format(
        *USUAL, *BEFORE, *interval(paired(means[USUAL], means[BEFORE]), "error")
    )
    return f"{markdown(_COLUMNS, cells)}\n\n" + "\n".join([*goals, less])


def of_recordings(rows: Rows) -> Rows:
    """Means over the cameras of each recording."""
    names = dict.fromkeys(row["recording"] for row in rows)
    own = {name: [row for row in rows if row["recording"] == name] for name in names}
    return [
        {"recording": name, **{column: sum(row[column] for row in each) / len(each) for column, _ in _NUMBERS}}
        for name, each in own.items()
    ]


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
