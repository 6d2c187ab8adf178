"""How far joints from two cameras' keypoints are from those of four, for docs/keypoints.md."""

from __future__ import annotations

import math
from collections.abc import Mapping

from poseppl.experiments.tables import Table, markdown

Tables = Mapping[str, Table]
MEDIAN, PERCENTILE_95 = {"1-4": 14.0, "2-4": 22.0}, {"1-4": 35.0, "2-4": 60.0}
"""The goals' errors, mm."""
HELD = {"coverage_50": (0.45, 0.55), "coverage_90": (0.85, 0.95)}
"""The goals' coverage."""
DEFAULT = "smoother, lasting errors"
"""The method whose answer users get."""
_COLUMNS = ("cameras", "method", "median", "95th percentile", "50 % intervals hold", "90 % intervals hold")


def keypoints(tables: Tables) -> str:
    """Errors and coverage by cameras and method, and which of the goals the default answer reaches."""
    cells, reached = [], []
    for row in tables["keypoints"].records():
        shares = ["" if math.isnan(row[name]) else f"{row[name]:.1%}" for name in HELD]
        cells.append(
            [
                row["cameras"].replace("-", " and "),
                row["method"],
                f"{row['median']:.1f}",
                f"{row['percentile_95']:.1f}",
                *shares,
            ]
        )
        if row["method"] == DEFAULT and row["cameras"] in MEDIAN:
            near = row["median"] <= MEDIAN[row["cameras"]] and row["percentile_95"] <= PERCENTILE_95[row["cameras"]]
            held = all(low <= row[name] <= high for name, (low, high) in HELD.items())
            reached.append((near, held))
    near, held = ("holds" if all(each) else "does not hold" for each in zip(*reached, strict=True))
    median, worst = (" and ".join(f"{limit:.0f}" for limit in goal.values()) for goal in (MEDIAN, PERCENTILE_95))
    return (
        f"{markdown(_COLUMNS, cells)}\n\nOf the last, the default, the goal of {median} mm in the median and {worst} mm at the "
        f"95th percentile {near}; that of 85 to 95 % in 90 % intervals and 45 to 55 % in 50 % ones, with both pairs, {held}."
    )
