"""Statements of docs/validation/published.md about Choo and Fleet 2001, from the tables of that page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.choo_fleet.claims import claims, goals
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
_TRACKERS = {"arm": "4-D arm", "lower_body": "10-D lower body", "full_body": "28-D full body"}
_METHODS = {
    "assumed density": "default",
    "assumed density, 1 Gaussian": "default, 1 Gaussian",
    "assumed density, short": "default, short chains",
    "window of 3": "window of 3",
    "tempered": "tempered SMC",
    "NUTS on all frames": "NUTS on all frames",
    "HMC, dense mass": "HMC, dense mass",
    "HMC, as published": "HMC, the paper's settings",
    "guided": "guided",
    "extended Kalman": "extended Kalman",
    "particle filter": "particle, N = 108,000",
}


def speed_ups(tables: Tables) -> str:
    """How many times less HMC needs, and the verdicts of the page by their kind."""
    rows = []
    for tracker, name in _TRACKERS.items():
        by = {row["by"]: row for row in tables["speed_ups"].records(tracker=tracker)}
        ours = [_interval(by[each]) for each in ("seconds", "evaluations")]
        rows.append([name, _times(by["seconds"]["published"]), *ours])
    lines = dict.fromkeys(f"- {claim.what}: {claim.verdict}" for claim in claims(tables))
    return "\n\n".join([markdown(("tracker", "published, time", "ours, time", "ours, evaluations"), rows), "\n".join(lines)])


def contest(tables: Tables) -> str:
    """The goals, and methods on sequences."""
    parts = {row["method"]: {} for row in tables["contest_sequences"].records()}
    for row in tables["contest_sequences"].records():
        parts[row["method"]][row["recording"]] = row
    rows = [[name, *_sequences(parts[method])] for method, name in _METHODS.items()]
    columns = ("method", "walk: error, mm; coverage of 90 and 50 % intervals", "simulated", "frames a second: walk; simulated")
    lines = "\n".join(f"- {goal.what}: {goal.verdict} ({goal.ours})" for goal in goals(tables))
    return f"{lines}\n\n{markdown(columns, rows)}\n\n{_dense(parts)}"


def _dense(parts: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    dense, theirs = (parts[name]["walk"] for name in ("HMC, dense mass", "HMC, as published"))
    ratio = dense["frames_per_second"] / theirs["frames_per_second"]
    cover = [f"{100 * row['markers_in_90']:.0f} %" for row in (dense, theirs)]
    return (
        f"On the walk a dense mass matrix and shorter trajectories make the paper's filter {ratio:.1f} times faster; the "
        f"coverage of its 90 % intervals is {cover[0]} instead of {cover[1]}."
    )


def _sequences(rows: Mapping[str, Mapping[str, Any]]) -> list[str]:
    pair = [rows[name] for name in ("walk", "simulated")]
    cells = [
        f"{row['error']:.1f} +- {row['error_standard_error']:.1f}; {100 * row['markers_in_90']:.1f}, "
        f"{100 * row['markers_in_50']:.1f} %"
        for row in pair
    ]
    return [*cells, "; ".join(f"{row['frames_per_second']:.3g}" for row in pair)]


def _interval(row: Mapping[str, Any]) -> str:
    return f"{_times(row['speed_up'])} ({_times(row['low'])} to {_times(row['high'])})"


def _times(ratio: float) -> str:
    """Write "50", or "1/8" where the particle filter is ahead."""
    times = max(ratio, 1 / ratio)
    shown = f"{times:,.0f}" if times >= 10 or times == round(times) else f"{times:.1f}"
    return shown if ratio >= 1 else f"1/{shown}"
