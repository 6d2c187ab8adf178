"""The page of many trials: a row each, and what is to be known of it, from plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl.report.page import DASH, page_html, with_interval

_GAIT = ("walking speed", "cadence", "stride length", "stride time", "stance")
"""Figures of gait that the page shows; the table has all."""


def trials_html(rows: Sequence[Mapping[str, Any]], passed_over: Sequence[str], level: float) -> str:
    """Make the page.

    Args:
        rows: One for each trial and person, with ``trial``, ``severity`` and ``verdict``. Tracked ones also have ``person``,
            ``frames``, ``rate``, ``residual``, ``deviation``, ``gait``, ``notes`` and ``file``. Walks have ``measures``: unit,
            number, mean, lower and upper end, by name and side.
        passed_over: Folders that are no trial, and why.
        level: Probability of the intervals.
    """
    failed = sum("error" in row for row in rows)
    doubtful = sum(row["severity"] in ("warning", "error") for row in rows)
    walks = sum("measures" in row for row in rows)
    trials = len({row["trial"] for row in rows})
    cards = [(f"{trials}", "trials"), (f"{len(rows) - failed}", "results"), (f"{failed}", "failed")]
    return page_html(
        "trials.html",
        "poseppl.motion.report",
        title="Trials",
        subtitle=f"{trials} trials, {len(rows)} rows",
        cards=[*cards, (f"{doubtful}", "with a warning or an error"), (f"{walks}", "walks")],
        data={"charts-data": {}},
        charts={},
        rows=[_row(row) for row in rows],
        gait=[_gait_row(row) for row in rows if "measures" in row],
        notes=[{"trial": _name(row), "note": note} for row in rows for note in row.get("notes", [])],
        passed_over=passed_over,
        level=f"{level:.0%}".replace("%", " %"),
    )


def _name(row: Mapping[str, Any]) -> str:
    person = row.get("person", 1)
    return f"{row['trial']}" + ("" if person == 1 else f", person {person}")


def _row(row: Mapping[str, Any]) -> dict[str, Any]:
    blank = {"frames": np.nan, "rate": np.nan, "cameras": np.nan, "residual": np.nan, "worst": DASH, "deviation": np.nan}
    return {**blank, "people seen": np.nan, "gait": DASH, "file": DASH, **row, "trial": _name(row)}


def _gait_row(row: Mapping[str, Any]) -> dict[str, str]:
    """Figures of a walk, with their intervals; left and right beside each other."""
    found = {"trial": _name(row)}
    for name in _GAIT:
        own = [row["measures"].get(name + side) for side in ("", " left", " right")]
        parts = [with_interval(*each[2:5]) for each in own if each is not None]
        found[name] = " / ".join(parts) or DASH
    return found
