"""What the library set out to reach beyond the paper, and whether the contest's tables show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from poseppl.experiments.tables import Table

PUBLISHED = "HMC, as published"
RATIO, RATE = 10.0, 60.0
BANDS = {"markers_in_90": (0.87, 0.93), "markers_in_50": (0.46, 0.54)}
_SMALL = 0.1
"""Bias, in posterior standard deviations, above which an estimate is not counted as one of the posterior's mean."""


class Goal(NamedTuple):
    """A goal.

    Attributes:
        what: The goal.
        ours: What was reached.
        verdict: "reached" or "not reached".
    """

    what: str
    ours: str
    verdict: str


def goals(tables: Mapping[str, Table]) -> list[Goal]:
    """The goals that the tables at hand decide."""
    found: list[Goal] = []
    if "contest" in tables and tables["contest"].select(method=PUBLISHED):
        found += [_cheaper(tables["contest"], by) for by in ("second", "evaluation")]
    if "contest_sequences" in tables:
        table = tables["contest_sequences"]
        found += [_calibrated(table, recording) for recording in dict.fromkeys(table.column("recording"))]
    return found


def _cheaper(table: Table, by: str) -> Goal:
    rows = _records(table)
    theirs = next(row for row in rows if row["method"] == PUBLISHED)
    best = max((row for row in rows if row["bias"] < _SMALL), key=lambda row: row[f"effective_draws_per_{by}"])
    ratio = best[f"effective_draws_per_{by}"] / theirs[f"effective_draws_per_{by}"]
    what = f"{RATIO:.0f} times fewer {by}s than the paper's settings at equal error of one frame's mean"
    ours = f"{best['method']}: {ratio:.3g} times fewer; bias {best['bias']:.2g} standard deviations"
    return Goal(what, ours, "reached" if ratio >= RATIO else "not reached")


def _calibrated(table: Table, recording: str) -> Goal:
    rows = [row for row in _records(table) if row["recording"] == recording]
    honest = [row for row in rows if all(low <= row[name] <= high for name, (low, high) in BANDS.items())]
    what = f"{RATE:.0f} frames a second, 90 % intervals covering 87 to 93 % and 50 % ones 46 to 54 %: {recording}"
    if not honest:
        nearest = min(rows, key=lambda row: abs(row["markers_in_90"] - 0.9) + abs(row["markers_in_50"] - 0.5))
        return Goal(what, f"no method is calibrated; the nearest is {_told(nearest)}", "not reached")
    best = max(honest, key=lambda row: row["frames_per_second"])
    return Goal(what, _told(best), "reached" if best["frames_per_second"] >= RATE else "not reached")


def _told(row: Mapping[str, Any]) -> str:
    cover = f"{100 * row['markers_in_90']:.1f} and {100 * row['markers_in_50']:.1f} %"
    return f"{row['method']}, {cover}, {row['error']:.0f} mm, {row['frames_per_second']:.0f} frames a second on one core"


def _records(table: Table) -> list[dict[str, Any]]:
    return [dict(zip(table.columns, row, strict=True)) for row in table.rows]
