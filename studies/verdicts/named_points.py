"""How well points of a held-out camera are predicted, and distances on a board, for docs/validation/points.md."""

from __future__ import annotations

from collections.abc import Mapping

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
MEDIAN = {"Cam-A": 1.6, "Cam-B": 1.0, "Cam-C": 2.8}
"""Median errors of EKS, px, which are to be no smaller."""
LOG_SCORE = {"Cam-A": -2.5, "Cam-B": -2.0, "Cam-C": -3.0}
"""Lower bound of the mean log score."""
HELD = {"coverage_50": (0.45, 0.55), "coverage_90": (0.85, 0.95)}
ALL = "median of three"


def fly(tables: Tables) -> str:
    """Scores by held-out camera and network, and which goals are reached with the median of the networks."""
    cells, reached = [], []
    for row in tables["named_points_fly"].records():
        held = [f"{row[name]:.1%}" for name in HELD]
        ours, linear = ([f"{row[f'{of}{name}']:.2f}" for name in ("median", "percentile_95")] for of in ("", "linear_"))
        cells.append([row["held_out"], row["network"], *ours, *held, f"{row['log_score']:.2f}", *linear])
        if row["network"] == ALL:
            near = row["median"] <= MEDIAN[row["held_out"]]
            inside = all(low <= row[name] <= high for name, (low, high) in HELD.items())
            reached.append((near, row["log_score"] > LOG_SCORE[row["held_out"]], inside))
    near, scored, inside = ("holds" if all(each) else "does not hold" for each in zip(*reached, strict=True))
    columns = ("held out", "network", "median, px", "95th percentile", "coverage of 50 %", "90 %", "log score")
    return (
        f"{markdown((*columns, 'linear: median', '95th percentile'), cells)}\n\nGoals for the median network: errors no "
        f"larger than EKS's: {near}; log scores above -2.5, -2 and -3: {scored}; coverage of 85 to 95 % for 90 % intervals and "
        f"of 45 to 55 % for 50 % ones: {inside}."
    )


def board(tables: Tables) -> str:
    """Errors and coverage of distances on a board, by cameras, and whether the goals are reached."""
    cells, reached = [], []
    for row in tables["named_points_board"].records():
        held = [f"{row[name]:.1%}" for name in HELD]
        names = ("median", "percentile_95", "linear_median", "linear_percentile_95")
        numbers = [f"{row[name]:.2f}" for name in names]
        cells.append([row["cameras"], f"{row['number']:.0f}", f"{row['distances']:.0f}", *numbers[:2], *held, *numbers[2:]])
        low, high = HELD["coverage_90"]
        reached.append((row["median"] <= row["linear_median"], low <= row["coverage_90"] <= high))
    near, inside = (sum(each) for each in zip(*reached, strict=True))
    columns = ("cameras", "number", "distances", "median, mm", "95th percentile", "coverage of 50 %", "90 %", "linear: median")
    return (
        f"{markdown((*columns, '95th percentile'), cells)}\n\nErrors no larger than those of linear triangulation: with {near} "
        f"of {len(reached)} sets of cameras; 85 to 95 % of the true distances in 90 % intervals: with {inside}."
    )
