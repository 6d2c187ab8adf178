"""Goals of the library beyond the paper, and whether the contest's tables show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from poseppl_papers.choo_fleet.plan import PUBLISHED_UPDATES
from poseppl_papers.experiment import Tables
from poseppl_papers.tables import Table

PUBLISHED = "HMC, as published"
RATIO, RATE = 10.0, 60.0
BANDS = {"markers_in_90": (0.87, 0.93), "markers_in_50": (0.46, 0.54)}
_SMALL = 0.1
"""Bias, in posterior standard deviations, above which an estimate is not counted as one of the posterior's mean."""


class Goal(NamedTuple):
    """A goal.

    Attributes:
        what: The goal.
        ours: Result.
        verdict: "reached" or "not reached".
    """

    what: str
    ours: str
    verdict: str


def goals(tables: Tables) -> list[Goal]:
    """The goals that the tables at hand decide."""
    found: list[Goal] = []
    if "contest" in tables and tables["contest"].select(method=PUBLISHED):
        found += [_fewer_seconds(tables), _fewer_evaluations(tables["contest"])]
    if "contest_sequences" in tables:
        table = tables["contest_sequences"]
        found += [_calibrated(table, recording) for recording in table.values("recording")]
    return found


def _fewer_seconds(tables: Tables) -> Goal:
    """Judged by the shorter of the times of the published settings: in the contest, and alone at single frames."""
    ratio, best, theirs = _ratio(tables["contest"], "second")
    ours = f"{ratio:.3g} times fewer"
    if "variances" in tables:
        alone = tables["variances"].column("seconds", tracker="full_body", method="hmc", size=PUBLISHED_UPDATES)
        if len(alone):
            other = ratio * float(alone[0]) / theirs["seconds"]
            ours = f"{ours} than theirs in the contest, {other:.3g} times fewer than theirs alone (variances.csv)"
            ratio = min(ratio, other)
    return _goal("seconds", best, ours, ratio)


def _fewer_evaluations(table: Table) -> Goal:
    ratio, best, _ = _ratio(table, "evaluation")
    return _goal("evaluations", best, f"{ratio:.3g} times fewer", ratio)


def _ratio(table: Table, by: str) -> tuple[float, dict[str, Any], dict[str, Any]]:
    """How many times more effective draws the best unbiased method has than the published settings, and both rows."""
    rows, name = table.records(), f"effective_draws_per_{by}"
    theirs = next(row for row in rows if row["method"] == PUBLISHED)
    best = max((row for row in rows if row["bias"] < _SMALL), key=lambda row: row[name])
    return best[name] / theirs[name], best, theirs


def _goal(what: str, best: Mapping[str, Any], ours: str, ratio: float) -> Goal:
    measured = f"{best['method']}: {ours}; bias {best['bias']:.2g} standard deviations"
    goal = f"{RATIO:.0f} times fewer {what} than the paper's settings at equal error of one frame's mean"
    return Goal(goal, measured, "reached" if ratio >= RATIO else "not reached")


def _calibrated(table: Table, recording: str) -> Goal:
    rows = table.records(recording=recording)
    calibrated = [row for row in rows if all(low <= row[name] <= high for name, (low, high) in BANDS.items())]
    what = f"{RATE:.0f} frames a second, 90 % intervals covering 87 to 93 % and 50 % ones 46 to 54 %: {recording}"
    if not calibrated:
        nearest = min(rows, key=lambda row: abs(row["markers_in_90"] - 0.9) + abs(row["markers_in_50"] - 0.5))
        return Goal(what, f"no method is calibrated; the nearest is {_told(nearest)}", "not reached")
    best = max(calibrated, key=lambda row: row["frames_per_second"])
    return Goal(what, _told(best), "reached" if best["frames_per_second"] >= RATE else "not reached")


def _told(row: Mapping[str, Any]) -> str:
    cover = f"{100 * row['markers_in_90']:.1f} and {100 * row['markers_in_50']:.1f} %"
    return f"{row['method']}, {cover}, {row['error']:.0f} mm, {row['frames_per_second']:.0f} frames a second on one core"
