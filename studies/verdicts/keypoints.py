"""How far joints from two cameras' keypoints are from those of four, for docs/validation/keypoints.md."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

from poseppl_papers.tables import Table, markdown

from studies.verdicts.named_points import ALL

Tables = Mapping[str, Table]
DEFAULT = "smoother, autocorrelated errors"
"""The method whose answer users get."""
_GOALS = {
    "median": ((0.0, 14.0), (0.0, 22.0)),
    "percentile_95": ((0.0, 35.0), (0.0, 60.0)),
    "coverage_50": ((0.45, 0.55),) * 2,
    "coverage_90": ((0.85, 0.95),) * 2,
    "ece": ((0.0, 0.05),) * 2,
}
"""Between what a column has to be for each of the pairs."""
_PAIRS = ("1-4", "2-4")
_COLUMNS = {
    "median": ("median", ".1f"),
    "percentile_95": ("95th percentile", ".1f"),
    "coverage_50": ("coverage of 50 % intervals", ".1%"),
    "coverage_90": ("coverage of 90 % intervals", ".1%"),
    "ece": ("ECE", ".3f"),
}


_FRAMES, _RATE, _COMPILING = 100, 60.0, 15.0
"""Frames of the recording; frames a second and seconds of compilation that are asked for."""
_STRAIGHT = "smoother without a filter"
_DEFAULT_PARTS = ("filter, assumed density", DEFAULT)
_FASTEST_PARTS = ("filter, Kalman", "smoother, Rauch-Tung-Striebel")


def keypoints(tables: Tables) -> str:
    """Errors and coverage by cameras and method, and which of the goals the default answer reaches with two cameras."""
    rows = tables["keypoints"].records()
    cells = [[str(row["cameras"]).replace("-", ", "), row["method"], *(_shown(row, name) for name in _COLUMNS)] for row in rows]
    default = [row for pair in _PAIRS for row in rows if (row["cameras"], row["method"]) == (pair, DEFAULT)]
    table = markdown(("cameras", "method", *(title for title, _ in _COLUMNS.values())), cells)
    alone = [row["coverage_90"] for row in rows if "-" not in str(row["cameras"])]
    low, high = min(alone), max(alone)
    goal = _holds(low >= 0.85 and high <= 0.95)
    sentences = f"One camera, coverage of 90 % intervals between 85 and 95 %: {goal} ({low:.1%} to {high:.1%})."
    head = "Goals of the last, the default, with two cameras:"
    return "\n".join([table, "", sentences, "", head, "", *(_verdict(name, default) for name in _GOALS)])


def _shown(row: Mapping[str, Any], name: str) -> str:
    return "" if math.isnan(row[name]) else format(row[name], _COLUMNS[name][1])


def _verdict(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Whether a column is within its goals in the rows of both pairs."""
    title, form = _COLUMNS[name]
    within = all(low <= row[name] <= high for row, (low, high) in zip(rows, _GOALS[name], strict=True))
    goals = " and ".join(dict.fromkeys(f"{low:{form}} to {high:{form}}" for low, high in _GOALS[name]))
    found = " and ".join(_shown(row, name) for row in rows)
    return f"- {title}, {goals}: {_holds(within)} ({found})."


def held_out(tables: Tables) -> str:
    """Coverage of held-out cameras by detector and number of cameras, with its range, and which goals are reached."""
    cells, verdicts = [], []
    kept = tables["held_out_cameras"].records()
    for detector in dict.fromkeys(str(row["detector"]) for row in kept):
        for number in (2, 3):
            own = [row for row in kept if (row["detector"], str(row["cameras"]).count("-") + 1) == (detector, number)]
            shares = {level: [row[f"coverage_{level}"] for row in own] for level in range(10, 100, 10)}
            if own:
                ece = fmean(abs(fmean(values) - level / 100) for level, values in shares.items())
                mm, share, lasts = (fmean(row[name] for row in own) for name in ("mm", "share", "lasts"))
                noise = (f"{mm:.0f} mm", f"{share:.0%}", f"{lasts:.2f} s")
                inside = (_over_cameras(shares[level]) for level in (50, 90))
                cells.append([detector, str(number), str(len(own)), *noise, *inside, f"{ece:.3f}"])
                good = 0.45 <= fmean(shares[50]) <= 0.55 and 0.85 <= fmean(shares[90]) <= 0.95 and ece < 0.05
                verdicts.append(f"- {detector}, {number} cameras: {_holds(good)}.")
    fly = [row for row in tables["named_points_fly"].records() if row["network"] != ALL] if "named_points_fly" in tables else []
    if fly:
        shares = {level: [row[f"coverage_{level}"] for row in fly] for level in (50, 90)}
        good = 0.45 <= fmean(shares[50]) <= 0.55 and 0.85 <= fmean(shares[90]) <= 0.95
        cells.append(["DeepLabCut, a fly", "2", str(len(fly)), "", "", "", *map(_over_cameras, shares.values()), ""])
        verdicts.append(f"- DeepLabCut, a fly, 2 cameras, without the ECE: {_holds(good)}.")
    noise = ("noise", "autocorrelated", "time constant")
    columns = ("detector", "cameras", "held out", *noise, "coverage of 50 % intervals", "coverage of 90 % intervals", "ECE")
    goal = "Mean coverage of 45 to 55 % and of 85 to 95 %, and an ECE below 0.05:"
    return "\n".join([markdown(columns, cells), "", goal, "", *verdicts])


def feet(tables: Tables) -> str:
    """Errors and coverage of feet, face and other markers by detector."""
    columns = ("detector", "markers", "positions", "median, mm", "95th percentile, mm", "in 50 %", "in 90 %", "ECE")
    cells = [
        [
            *(row["detector"], row["markers"], f"{row['places']:,}", f"{row['median']:.1f}", f"{row['percentile_95']:.1f}"),
            *(f"{row['coverage_50']:.1%}", f"{row['coverage_90']:.1%}", f"{row['ece']:.3f}"),
        ]
        for row in tables["feet"].records()
    ]
    return markdown(columns, cells)


def _over_cameras(shares: Sequence[float]) -> str:
    """Mean and range."""
    return f"{fmean(shares):.0%} ({min(shares):.0%} to {max(shares):.0%})"


def speed(tables: Tables) -> str:
    """Seconds by part, and which of the goals the default and the fastest pair of a filter and a smoother reach.

    In a table of a time before recordings were smoothed without a filter, the default is a pair, too.
    """
    rows = {str(row["part"]): row for row in tables["keypoint_speed"].records()}
    columns = ("part", "first run, s", "later run, s", "error, mm", "95th percentile")
    numbers = ("first_seconds", "seconds", "error", "error_95")
    cells = [[part, *("" if math.isnan(row[name]) else f"{row[name]:.1f}" for name in numbers)] for part, row in rows.items()]
    sentences = []
    default = ("default smoother", (_STRAIGHT,)) if _STRAIGHT in rows else ("default filter and smoother", _DEFAULT_PARTS)
    for name, parts in (default, ("fastest filter and smoother", _FASTEST_PARTS)):
        first, later = (sum(rows[part][column] for part in parts) for column in ("first_seconds", "seconds"))
        rate, compiling = _FRAMES / later, first - later
        sentences.append(
            f"- The {name}, {_RATE:.0f} frames a second: {_holds(rate >= _RATE)} ({rate:.1f}); compiled in "
            f"{_COMPILING:.0f} s: {_holds(compiling <= _COMPILING)} ({compiling:.0f} s)."
        )
    return "\n".join([markdown(columns, cells), "", *sentences])


def _holds(holds: bool) -> str:
    return "holds" if holds else "does not hold"
