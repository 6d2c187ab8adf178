"""Compile times of algorithms on the body, and whether they stay within the goal, for docs/validation/speed.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
MOST = 20.0
"""The goal's processor seconds of compilation."""
_COLUMNS = ("", "compilation, s", "a run, s", "memory, MiB")


def compile_times(tables: Tables) -> str:
    """Processor seconds and memory by algorithm, and which of them compile longer than the goal."""
    nothing, *rows = tables["compile_times"].records()
    assert nothing["kind"] == "none"
    cells = [[_name(row), f"{row['compilation']:.1f}", f"{row['run']:.1f}", f"{row['memory']:,.0f}"] for row in rows]
    longer = {kind: _longer([row for row in rows if row["kind"] == kind]) for kind in ("filter", "smoother")}
    counted = "; ".join(f"{many} of {count} {kind}s take more" for kind, (many, count) in longer.items())
    verdict = "holds" if not any(many for many, _ in longer.values()) else "does not hold"
    return (
        f"{markdown(_COLUMNS, cells)}\n\nA process that has only loaded the libraries uses {nothing['memory']:,.0f} MiB. "
        f"At most {MOST:.0f} processor seconds of compilation each: {verdict}, {counted}."
    )


def _name(row: Mapping[str, Any]) -> str:
    return ", ".join(filter(None, (f"{row['kind']} {row['name']}", str(row["settings"] or ""))))


def _longer(rows: list[dict[str, Any]]) -> tuple[int, int]:
    return sum(row["compilation"] > MOST for row in rows), len(rows)
