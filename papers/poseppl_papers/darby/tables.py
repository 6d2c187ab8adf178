"""How the page tells the tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from poseppl_papers.darby.plan import MODIFIED, STANDARD
from poseppl_papers.experiment import Jobs, Results, Tables
from poseppl_papers.images.tables import ABOUT, COLUMNS, filter_row, filter_rows, told_errors
from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, grouped, markdown

_TITLES = (
    ("Eq. 8, four cameras", "trackers", STANDARD),
    ("Eq. 8, one camera: the standard weight", "one_camera", STANDARD),
    ("Eq. 9, one camera: the modified weight", "one_camera", MODIFIED),
)


def trackers(tables: Tables) -> str:
    """Errors of the annealed filter with four cameras, and with one under both weights."""
    rows = []
    for title, table, system in _TITLES:
        for row in filter_rows(tables, table, system=system.name):
            count = row["method"].split(" x ")[1]
            rows.append([title, count, *told_errors(row), f"{row['seconds']:.2g}", str(row["runs"])])
    columns = ("weight", "particles a layer", "error", "relative", "best particle", "s a frame", "runs")
    return markdown(columns, rows)


def taught(name: str, jobs: Jobs, results: Results) -> list[Table]:
    """One row a system, walk and method."""
    return [Table(name, COLUMNS, [filter_row([job], results) for job in jobs["tracking"]], ABOUT)]


def guided_errors(tables: Tables) -> str:
    """Errors over walks, of which each is the mean of its runs, with 95 % intervals, and the deviation of runs of one walk."""
    rows = []
    for name in ("guided", "guided_one_camera"):
        groups = grouped(filter_rows(tables, name), lambda row: (row["system"], row["method"]))
        for (system, method), mine in groups.items():
            cells = [_over_walks(mine, figure) for figure in _GUIDED]
            seconds = sum(row["seconds"] for row in mine) / len(mine)
            rows.append([system, method, str(len(mine)), str(mine[0]["runs"]), *cells, f"{seconds:.2g}"])
    columns = ("system", "filter", "walks", "runs", "best particle", "error", "relative", "weighted, relative", "s a frame")
    return markdown(columns, rows)


_GUIDED = ("optimistic", "absolute", "relative", "weighted_relative")


def _over_walks(rows: Sequence[dict[str, Any]], figure: str) -> str:
    runs = math.sqrt(sum(row[f"{figure}_sd"] ** 2 for row in rows) / len(rows))
    return f"{mean_interval([row[figure] for row in rows]).text()}, runs +- {runs:.1f}"
