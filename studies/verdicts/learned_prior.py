"""A learned walk as the prior of people it was not learned from, and of other motion, for docs/validation/motion.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import mean
from typing import Any, NamedTuple

from poseppl_papers.measured import mean_interval
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
OTHER = {"02_03": "run", "02_04": "jump", "02_05": "punch"}
"""Recordings that are no walks."""
CASES = {"alone": "activity alone", "mixture": "activity or other motion", "default": "no prior"}
LEAST, MOST = 85.0, 95.0
"""Goals: bounds of the coverage of 90 % intervals, %."""
Row = Mapping[str, Any]


class Goals(NamedTuple):
    """Goals of walks: an error below so many mm, and so many frames a second, if any."""

    error: float
    pace: float | None = None


def points(tables: Tables) -> str:
    """Errors and coverage by recording and case, and which goals are reached on walks seen as points."""
    return _section(tables["learned_prior"], Goals(25.0, 20.0))


def silhouettes(tables: Tables) -> str:
    """The same of silhouettes, whose published error is 57 mm; and whether their overlap shows other motion."""
    table = tables["learned_prior_silhouettes"]
    lines = {row["recording"]: row["overlap"] != "none" for row in table.records() if row["case"] == "mixture"}
    count = {other: [warned for name, warned in lines.items() if (name in OTHER) == other] for other in (True, False)}
    return (
        f"{_section(table, Goals(57.0))}\n- The verdict on the overlap with the silhouettes, a warning or an error, reports "
        f"{sum(count[True])} of {len(count[True])} recordings that are no walks, and {sum(count[False])} of "
        f"{len(count[False])} walks."
    )


def _section(table: Table, goals: Goals) -> str:
    rows: dict[str, dict[str, list[Row]]] = {}
    for row in table.records():
        rows.setdefault(row["recording"], {}).setdefault(row["case"], []).append(row)
    walks = [own for name, own in rows.items() if name not in OTHER]
    cases = [case for case in CASES if all(case in own for own in rows.values())]
    cells = [
        [_name(name), *(_cell(own[case]) for case in cases), f"{_mean(own['mixture'], 'probability'):.2f}", *_overlap(own)]
        for name, own in rows.items()
    ]
    head = ["", *(CASES[case] for case in cases), "probability of the activity", "verdict on the overlap"]
    lines = "\n".join(f"- {_goals(case, [own[case] for own in walks], goals)}" for case in ("alone", "mixture"))
    noticed = [_name(name) for name in rows if name in OTHER and _mean(rows[name]["mixture"], "probability") < 0.5]
    mistaken = [name for name in rows if name not in OTHER and _mean(rows[name]["mixture"], "probability") < 0.5]
    named = f" ({', '.join(mistaken)})" if mistaken else ""
    return (
        f"{markdown(head[: len(cells[0])], cells)}\n\n{lines}\n- Other motion has the larger probability on {len(noticed)} of "
        f"{sum(name in OTHER for name in rows)} recordings that are no walks, and on {len(mistaken)} of "
        f"{len(walks)} walks{named}."
    )


def _overlap(own: Mapping[str, list[Row]]) -> list[str]:
    return [row["overlap"] for row in own["mixture"][:1] if "overlap" in row]


def _name(name: str) -> str:
    return f"{name}, {OTHER[name]}" if name in OTHER else name


def _mean(runs: list[Row], column: str) -> float:
    return mean(float(run[column]) for run in runs)


def _cell(runs: list[Row]) -> str:
    return f"{_mean(runs, 'error'):.0f}, {100 * _mean(runs, 'coverage_90'):.0f} %"


def _goals(case: str, walks: list[list[Row]], goals: Goals) -> str:
    """Results of a case on walks: means over recordings with 95 % intervals by Student's t."""
    coverage = [100 * _mean(runs, "coverage_90") for runs in walks]
    half = [100 * _mean(runs, "coverage_50") for runs in walks]
    error, pace = ([_mean(runs, column) for runs in walks] for column in ("error", "frames_per_second"))
    lines = [
        f"coverage of 90 % intervals is {_told(coverage)} %, 85 to 95 asked for: {_verdict(LEAST <= mean(coverage) <= MOST)}",
        f"error {_told(error)} mm, below {goals.error:.0f}: {_verdict(mean(error) < goals.error)}",
        f"{mean(pace):.0f} frames a second"
        + ("" if goals.pace is None else f", {goals.pace:.0f}: {_verdict(mean(pace) >= goals.pace)}"),
    ]
    name = CASES[case].capitalize()
    return f"{name}, mean of {len(walks)} walks: {'; '.join(lines)}. The coverage of 50 % intervals is {_told(half)} %."


def _verdict(holds: bool) -> str:
    return "holds" if holds else "does not hold"


def _told(values: list[float]) -> str:
    middle, least, _ = mean_interval(values)
    return f"{middle:.1f} ± {middle - least:.1f}"
