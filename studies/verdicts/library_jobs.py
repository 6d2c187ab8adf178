"""Jobs for time series in several libraries: lines, seconds and errors, for docs/validation/libraries.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from poseppl_papers.tables import Table, grouped, markdown

Tables = Mapping[str, Table]
COLUMNS = ("library", "method", "lines", "first run, s", "later runs, ms", "error")


def jobs(*names: str) -> Callable[[Tables], str]:
    """The section of some jobs: a row for each library and method, with one number for each turn.

    Args:
        names: The jobs, as benchmarks/peers names them; with several, a column tells which.
    """
    columns = (*(("job",) if len(names) > 1 else ()), *COLUMNS)

    def section(tables: Tables) -> str:
        records = [row for name in names for row in tables["library_jobs"].records(job=name)]
        by_method = grouped(records, lambda row: (row["job"], row["library"], row["method"]))
        return markdown(columns, [[*key[len(names) == 1 :], *_cells(turns)] for key, turns in by_method.items()])

    return section


def _cells(turns: Sequence[Mapping[str, Any]]) -> list[str]:
    if "" in (turns[0]["first_seconds"], turns[0]["error"]):
        return [str(turns[0]["lines"]), "not in 300 s", "", ""]
    first = ", ".join(
        f"{row['first_seconds']:.2g}" if row["first_seconds"] < 10 else f"{row['first_seconds']:.0f}" for row in turns
    )
    later = ", ".join(_milliseconds(row["seconds"]) for row in turns)
    return [str(turns[0]["lines"]), first, later, f"{sum(row['error'] for row in turns) / len(turns):.4f}"]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.2g}" if seconds < 0.1 else f"{1e3 * seconds:,.0f}"
