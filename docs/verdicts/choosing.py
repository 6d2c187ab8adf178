"""Which filter for which model by trials, for docs/choosing.md."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from poseppl.experiments.tables import Table, markdown

Tables = Mapping[str, Table]
_COLUMNS = ("model", "filter", "seeds", "error, least is 1", "90 % intervals hold", "s", "red")


def choosing(tables: Tables) -> str:
    """Error over the least of a model's, coverage, seconds and verdicts, the best first; and which filters refuse which."""
    rows = tables["choosing"].records()
    shown, refused = [], []
    for model in dict.fromkeys(row["model"] for row in rows):
        mine = [row for row in rows if row["model"] == model]
        ran = sorted((row for row in mine if not row["refused"]), key=lambda row: float(row["error"]))
        shown += [_cells(row, float(ran[0]["error"])) for row in ran]
        names = [row["filter"] for row in mine if row["refused"]]
        refused += [f"{model} by {', '.join(names)}"] if names else []
    return f"{markdown(_COLUMNS, shown)}\n\nRefused: {'; '.join(refused)}."


def _cells(row: Mapping[str, Any], least: float) -> list[str]:
    coverage, seeds = float(row["coverage"]), int(row["seeds"])
    holds = "" if math.isnan(coverage) else f"{100 * coverage:.0f} %"
    relative, seconds = float(row["error"]) / least, float(row["seconds"])
    return [
        row["model"],
        row["filter"],
        str(seeds),
        f"{relative:.2f}",
        holds,
        f"{seconds:.2g}",
        f"{int(row['red'])} of {seeds}",
    ]
