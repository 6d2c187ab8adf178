"""Filters of a chaotic state in 40 dimensions, and whether verdicts tell those that fail, for docs/validation/filters.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import mean
from typing import Any

from poseppl_papers.tables import Table, markdown

from studies.verdicts.predictions import goal, grouped

Tables = Mapping[str, Table]


def ensembles(tables: Tables) -> str:
    """Error, coverage and verdicts by filter, for each uncertainty of the first state, and whether the two goals hold."""
    rows = [
        {**row, "model": f"the first state within {row['spread']:g}", "errors": row["verdict"]}
        for row in tables["ensembles"].records()
    ]
    groups = grouped(rows, str)
    models, names = (list(dict.fromkeys(key[part] for key in groups)) for part in (0, 1))
    columns = ["filter", *(f"{model}: {what}" for model in models for what in ("error; coverage", "red"))]
    shown = [[name, *(cell for model in models for cell in _cells(groups[model, name]))] for name in names]
    return f"{markdown(columns, shown)}\n\n{goal(rows, groups, 'below')}\n{goal(rows, groups, 'above')}"


def _cells(group: list[dict[str, Any]]) -> list[str]:
    errors, holds = [row["error"] for row in group], 100 * mean(row["coverage"] for row in group)
    red = sum(row["errors"] != "none" for row in group)
    return [f"{mean(errors):.2f} ({min(errors):.2f} to {max(errors):.2f}); {holds:.0f} %", f"{red} of {len(group)}"]
