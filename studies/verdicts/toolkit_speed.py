"""How fast the toolkit is, and its goals, for docs/validation/speed.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
FIRST, SECOND = 2.0, 1.0
"""The goals' processor seconds of a first result, and of a second filter's on the same model."""
_HOLDS = {True: "holds", False: "does not hold"}


def beside_rivals(tables: Tables) -> str:
    """Processor milliseconds of jobs and their rivals, and whether ratios are within the goals."""
    rows = tables["toolkit_speed"].records()
    columns = ("", "ms", "beside it", "ms", "ratio")
    cells = [
        [row["job"], f"{1e3 * row['seconds']:,.1f}", row["rival"], f"{1e3 * row['rival_seconds']:,.1f}", f"{_ratio(row):.2f}"]
        for row in rows
    ]
    goals = [
        f"{row['job']}, at most {row['goal']:g} times: {_HOLDS[_ratio(row) <= row['goal']]}" for row in rows if row["goal"]
    ]
    return f"{markdown(columns, cells)}\n\n{'; '.join(goals)}."


def first_results(tables: Tables) -> str:
    """Processor seconds of first results, and whether they are within the goals."""
    rows = tables["first_results"].records()
    columns = ("first filter", "its result, s", "second filter", "its result, s", "the first again, s")
    names = ("first_result", "second_filter", "again")
    cells = [
        [row["first"], f"{row['first_result']:.2f}", row["second"], *(f"{row[name]:.2f}" for name in names[1:])] for row in rows
    ]
    first = _told([(row["first"], row["first_result"] <= FIRST) for row in rows])
    second = _told([(f"{row['second']} after {row['first']}", row["second_filter"] <= SECOND) for row in rows])
    goals = (
        f"A first result in at most {FIRST:g} processor seconds: {first}. A second filter's in at most {SECOND:g}: {second}."
    )
    return f"{markdown(columns, cells)}\n\n{goals}"


def _ratio(row: Mapping[str, Any]) -> float:
    return float(row["seconds"] / row["rival_seconds"])


def _told(cases: list[tuple[str, bool]]) -> str:
    missed = [name for name, within in cases if not within]
    return f"does not hold ({', '.join(missed)})" if missed else "holds"
