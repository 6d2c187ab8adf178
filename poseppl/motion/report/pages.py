"""The pages of a gait and of many trials, from plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from poseppl.diagnostics.selection import Array
from poseppl.report.chart import DOTTED, Panel, fan, grid, line
from poseppl.report.page import DASH, page_html, with_interval
from poseppl.report.picture import MUTED, OBSERVED, POSTERIOR

_COLORS = {"left": ("rgba(228,87,46,0.22)", OBSERVED), "right": ("rgba(31,111,139,0.22)", POSTERIOR)}
_CARDS = ("walking speed", "cadence", "stride length", "stance")
_COLUMNS, _HEIGHT = 3, 190
_PERCENT = {"range": [0, 100], "tickvals": [0, 20, 40, 60, 80]}
"""An axis without a tick at 100 %, which would touch the 0 of the next chart."""


class ShownCycle(NamedTuple):
    """An angle over the gait cycle.

    Attributes:
        title: Its name, without side.
        side: "left" or "right".
        lines: Lower end, mean and upper end (3, P), degrees, from 0 to 100 %.
        off: Mean toe off, %; None where unknown.
    """

    title: str
    side: str
    lines: Array
    off: float | None


class ShownMeasure(NamedTuple):
    """A figure: its side is "left", "right" or "both"; ``between`` is the standard deviation between ``number`` strides."""

    name: str
    side: str
    unit: str
    number: int
    mean: float
    lower: float
    upper: float
    between: float

    @property
    def text(self) -> str:
        """The figure with its interval and its deviation."""
        return with_interval(self.mean, self.lower, self.upper, self.between)


def gait_html(
    title: str,
    measures: Sequence[ShownMeasure],
    cycles: Sequence[ShownCycle],
    events: Sequence[Mapping[str, object]],
    notes: Sequence[str],
    level: float,
) -> str:
    """Make the page.

    Args:
        title: Title of the page.
        measures: The figures.
        cycles: The angles.
        events: Rows with ``kind``, ``side``, ``mean``, ``lower`` and ``upper``, seconds.
        notes: Notes for the reader.
        level: Level of the intervals.
    """
    charts = {"cycles": _cycle_chart(cycles)}
    charts = {name: each for name, each in charts.items() if each is not None}
    return page_html(
        "gait.html",
        "poseppl.motion.report",
        title=title,
        subtitle=f"{len(events)} events",
        cards=[_card(name, measures) for name in _CARDS if any(each.name == name for each in measures)],
        data={"charts-data": charts},
        charts=charts,
        measures=_rows(measures),
        events=events,
        notes=notes,
        level=f"{level:.0%}".replace("%", " %"),
    )


def _card(name: str, measures: Sequence[ShownMeasure]) -> tuple[str, str]:
    own = [each for each in measures if each.name == name]
    sides = " · left / right" if len(own) > 1 else ""
    return " / ".join(f"{each.mean:.3g}" for each in own), f"{name}, {own[0].unit}{sides}"


def _rows(measures: Sequence[ShownMeasure]) -> list[dict[str, str]]:
    """A row of each figure, with its sides beside each other."""
    rows: dict[str, dict[str, str]] = {}
    for each in measures:
        blank = {"name": each.name, "unit": each.unit, "left": DASH, "right": DASH, "both": DASH, "count": ""}
        row = rows.setdefault(each.name, blank)
        row[each.side] = each.text
        row["count"] += (" / " if row["count"] else "") + str(each.number)
    return list(rows.values())


def _cycle_chart(cycles: Sequence[ShownCycle]) -> object:
    titles = dict.fromkeys(each.title for each in cycles)
    panels = []
    for title in titles:
        traces = []
        for each in (cycle for cycle in cycles if cycle.title == title):
            percent = [100 * k / (each.lines.shape[1] - 1) for k in range(each.lines.shape[1])]
            traces += fan(percent, each.lines, (f"{each.side}, interval", each.side), _COLORS[each.side])
            if each.off is not None:
                ends = np.array([each.lines.min(), each.lines.max()])
                traces.append(line([each.off, each.off], ends, "toe off", MUTED, **DOTTED))
        panels.append(Panel(traces, f"{title}, degrees", xaxis=_PERCENT))
    rows = -(-len(panels) // _COLUMNS)
    return grid(panels, columns=min(_COLUMNS, max(1, len(panels))), height=60 + _HEIGHT * rows)


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
