"""Whether smoothing pays, with smoothers that are not bound to the filter's particles, for docs/validation/smoothing.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import mean
from typing import Any

from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
FILTER = "filter"


def smoothing_pays(tables: Tables) -> str:
    """Errors, coverage and cost by cameras and method, and which smoothers have smaller errors than the filter."""
    records = tables["smoothing_pays"].records()
    rows, sentences = [], []
    for kind, cameras in sorted({(row["seen"], row["cameras"]) for row in records}, key=lambda pair: (pair[0], int(pair[1]))):
        seen = [row for row in records if (row["seen"], row["cameras"]) == (kind, cameras)]
        before = {_run(row): float(row["error"]) for row in seen if row["method"] == FILTER}
        found: dict[str, list[str]] = {"holds": [], "undecided": [], "does not hold": []}
        number = len({_run(row) for row in seen})
        for method in dict.fromkeys(row["method"] for row in seen):
            own = [row for row in seen if row["method"] == method]
            less = {_run(row): 100 * (1 - float(row["error"]) / before[_run(row)]) for row in own}
            share, low, high = mean_interval(_independent(kind, less))
            if method != FILTER:
                verdict = "holds" if low > 0 else "undecided" if high > 0 else "does not hold"
                found[verdict].append(f"{method} by {share:.0f} % ({low:.0f} to {high:.0f})")
            gain = "" if method == FILTER else f"{share:.0f} ({low:.0f} to {high:.0f})"
            shares = [f"{100 * _mean(own, column):.0f}" for column in ("coverage_50", "coverage_90")]
            rows.append([kind, cameras, method, f"{_mean(own, 'error'):.0f}", gain, *shares, f"{_seconds(own):.2g}"])
        said = "; ".join(f"{verdict}: {', '.join(methods)}" for verdict, methods in found.items() if methods)
        sentences.append(f"- {kind.capitalize()}, {_plural(int(cameras))}, {number} runs: smoothing pays: {said}.")
    columns = ("seen", "cameras", "", "error", "% less", "coverage of 50 %", "90 %", "s a frame")
    return f"{markdown(columns, rows)}\n\n" + "\n".join(sentences)


def _independent(kind: str, runs: Mapping[tuple[str, str], float]) -> list[float]:
    """Values of runs; of silhouettes, whose pictures are the same for all seeds, their means by walk."""
    if kind == "points":
        return list(runs.values())
    return [mean(value for (own, _), value in runs.items() if own == walk) for walk in dict.fromkeys(walk for walk, _ in runs)]


def _run(row: Mapping[str, Any]) -> tuple[str, str]:
    return str(row["walk"]), str(row["seed"])


def _mean(rows: list[Mapping[str, Any]], column: str) -> float:
    return mean(float(row[column]) for row in rows)


def _seconds(rows: list[Mapping[str, Any]]) -> float:
    """The median, which leaves the run that compiles out."""
    found = sorted(float(row["seconds"]) for row in rows)
    return found[len(found) // 2]


def _plural(cameras: int) -> str:
    return f"{cameras} camera{'s' * (cameras > 1)}"
