"""Errors of events, steps and strides, and coverage, for docs/validation/keypoints.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.tables import Table, markdown

from studies.verdicts.one_camera import LEAST, MOST

Tables = Mapping[str, Table]
STRIKES, OFFS, CAMERAS = "heel strike, ms", "toe off, ms", "four cameras"
FIGURES = (STRIKES, OFFS, "step time, ms", "stride time, ms", "step length, mm", "stride length, mm", "walking speed, mm/s")
_COLUMNS = (
    *("", "number", "cameras less markers", "SD of people", "largest", "coverage of 90 % intervals, %"),
    *("cameras less laboratory", "cameras less plates"),
)


def gait(tables: Tables) -> str:
    """Errors of the cameras, and whether the coverage of intervals is right."""
    cells = [_cells(tables, figure) for figure in FIGURES]
    goals = [
        f"- coverage of 90 % intervals of {what} is {LEAST:.0f} to {MOST:.0f} %, against markers: {_verdict(row)}."
        for what, figure in (("heel strikes", STRIKES), ("toe-offs", OFFS))
        for row in records(tables, figure, "markers")
        if row["person"] == "all"
    ]
    return f"{markdown(_COLUMNS, cells)}\n\n" + "\n".join(goals)


def records(tables: Tables, figure: str, reference: str, method: str = CAMERAS, share: float = 0.5) -> list[dict[str, Any]]:
    """The rows of a figure, of the default rule in cameras, by person."""
    return tables["gait"].records(figure=figure, reference=reference, method=method, strike_share=share)


def _cells(tables: Tables, figure: str) -> list[str]:
    row = next(each for each in records(tables, figure, "markers") if each["person"] == "all")
    others = [
        " and ".join(str(round(each["bias"])) for each in records(tables, figure, reference) if each["person"] != "all")
        for reference in ("laboratory", "force plate")
    ]
    bias = (row[name] for name in ("bias", "bias_lower", "bias_upper"))
    whole = [_with_interval(*bias), f"{row['sd']:.1f}", f"{row['largest']:.0f}"]
    return [figure, str(row["number"]), *whole, _with_interval(*_coverage(row)), *others]


def _with_interval(mean: float, low: float, high: float) -> str:
    """Rounded, without an interval where all people are equal."""
    return f"{round(mean)} ({round(low)} to {round(high)})" if low < high else f"{round(mean)}"


def _coverage(row: Mapping[str, Any]) -> tuple[float, float, float]:
    """Percent, and the ends of its interval."""
    mean, low, high = (100 * row[name] for name in ("coverage_90", "coverage_lower", "coverage_upper"))
    return mean, low, high


def _verdict(row: Mapping[str, Any]) -> str:
    mean, low, high = _coverage(row)
    said = f"{_with_interval(mean, low, high)} % of {row['number']}"
    if high < LEAST or low > MOST:
        return f"does not hold, {said}"
    return f"holds, {said}" if low >= LEAST and high <= MOST else f"undecided, {said}"
