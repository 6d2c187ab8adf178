"""A learned walk as the prior of people it was not learned from, and of other motion, for docs/measurements.md."""

from __future__ import annotations

from collections.abc import Mapping
from statistics import mean
from typing import Any

from poseppl.experiments.measured import mean_interval
from poseppl.experiments.tables import Table, markdown

Tables = Mapping[str, Table]
OTHER = {"02_03": "run", "02_04": "jump", "02_05": "punch"}
"""Recordings that are no walks."""
CASES = ("alone", "mixture", "default")
LEAST, MOST, ERROR, PACE = 85.0, 95.0, 25.0, 20.0
"""Goals: bounds of the coverage of 90 % intervals, %; error, mm; frames a second."""


def learned_prior(tables: Tables) -> str:
    """Errors and coverage by recording and case, and which goals are reached on walks."""
    rows: dict[str, dict[str, list[Mapping[str, Any]]]] = {}
    for row in tables["learned_prior"].records():
        rows.setdefault(row["recording"], {}).setdefault(row["case"], []).append(row)
    walks = [own for name, own in rows.items() if name not in OTHER]
    cells = [
        [_name(name), *(_cell(own[case]) for case in CASES), f"{_mean(own['mixture'], 'probability'):.2f}"]
        for name, own in rows.items()
    ]
    head = ("", "activity alone", "activity or other motion", "no prior", "probability of the activity")
    told = "\n".join(f"- {_goals(case, [own[case] for own in walks])}" for case in ("alone", "mixture"))
    noticed = [_name(name) for name in rows if name in OTHER and _mean(rows[name]["mixture"], "probability") < 0.5]
    mistaken = [name for name in rows if name not in OTHER and _mean(rows[name]["mixture"], "probability") < 0.5]
    named = f" ({', '.join(mistaken)})" if mistaken else ""
    return (
        f"{markdown(head, cells)}\n\n{told}\n- Other motion has the larger probability on {len(noticed)} of "
        f"{sum(name in OTHER for name in rows)} recordings that are no walks, and on {len(mistaken)} of "
        f"{len(walks)} walks{named}."
    )


def _name(name: str) -> str:
    return f"{name}, {OTHER[name]}" if name in OTHER else name


def _mean(runs: list[Mapping[str, Any]], column: str) -> float:
    return mean(float(run[column]) for run in runs)


def _cell(runs: list[Mapping[str, Any]]) -> str:
    return f"{_mean(runs, 'error'):.0f}, {100 * _mean(runs, 'coverage_90'):.0f} %"


def _goals(case: str, walks: list[list[Mapping[str, Any]]]) -> str:
    """What a case reaches on walks: means over recordings with 95 % intervals by Student's t."""
    coverage = [100 * _mean(runs, "coverage_90") for runs in walks]
    half = [100 * _mean(runs, "coverage_50") for runs in walks]
    error, pace = ([_mean(runs, column) for runs in walks] for column in ("error", "frames_per_second"))
    reached = {
        f"90 % intervals hold {_told(coverage)} %, 85 to 95 asked for": LEAST <= mean(coverage) <= MOST,
        f"error {_told(error)} mm, below {ERROR:.0f}": mean(error) < ERROR,
        f"{mean(pace):.0f} frames a second, {PACE:.0f}": mean(pace) >= PACE,
    }
    name = {"alone": "Activity alone", "mixture": "Activity or other motion"}[case]
    goals = "; ".join(f"{words}: {'holds' if holds else 'does not hold'}" for words, holds in reached.items())
    return f"{name}, mean of {len(walks)} walks: {goals}. 50 % intervals hold {_told(half)} %."


def _told(values: list[float]) -> str:
    middle, least, _ = mean_interval(values)
    return f"{middle:.1f} ± {middle - least:.1f}"
