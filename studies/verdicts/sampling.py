"""Speed of filters and of samplers of whole trajectories, and what it says of goals, for docs/validation."""

from __future__ import annotations

import math
from collections.abc import Mapping

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
RATE, TIMES = 30.0, 5.0
"""Goals: frames a second at the settings of Choo and Fleet, and draws a second over NumPyro's NUTS."""


RELIABLE = 100.0
"""An effective sample of four chains that can be relied on."""


def filters(tables: Tables) -> str:
    """Frames a second, and the goal at the paper's settings."""
    rows = tables["filters"].records()
    shown = [[row["method"], _number(row["frames_per_second"]), f"{row['compilation']:.0f} s"] for row in rows]
    reached = "was reached" if rows[0]["frames_per_second"] >= RATE else "was not reached"
    goal = f"The goal of {RATE:.0f} frames a second at the paper's setting {reached} on the loaded machine."
    return f"{markdown(('', 'frames a second', 'compilation'), shown)}\n\n{goal}"


def trajectory(tables: Tables) -> str:
    """Effective draws a second beside NumPyro's NUTS, and the goal."""
    rows = tables["trajectory"].records()
    shown = [
        [
            f"{row['frames']}{' (`--quick`)' if row['frames'] == 5 else ''}",
            *(_pair(row[f"{name}worst"], row[f"{name}median"]) for name in ("", "numpyro_", "ratio_")),
        ]
        for row in rows
    ]
    reached = [min(row["ratio_worst"], row["ratio_median"]) >= TIMES for row in rows]
    sentence = [f"{row['frames']} frames: {'' if each else 'not '}reached" for row, each in zip(rows, reached, strict=True)]
    goal = f"The goal of {TIMES:.0f} times as many effective draws a second, by processor time: {'; '.join(sentence)}."
    return f"{markdown(('frames', 'poseppl, worst; median coordinate', 'NumPyro', 'ratio'), shown)}\n\n{goal}"


def particle_mgrad(tables: Tables) -> str:
    """Effective draws a second of processor time of Particle-mGRAD beside our NUTS, and the goal."""
    rows = tables["particle_mgrad"].records()
    rates = [[row[f"ess_{place}"] / row["cpu_seconds"] for place in ("worst", "median")] for row in rows]
    shown = [
        [
            row["method"],
            f"{row['draws']}",
            _number(row["cpu_seconds"]),
            _pair(row["ess_worst"], row["ess_median"]),
            _pair(*rate),
        ]
        for row, rate in zip(rows, rates, strict=True)
    ]
    nuts, mgrad = rates
    worst, median = (ours / theirs for ours, theirs in zip(mgrad, nuts, strict=True))
    header = ("sampler", "draws a chain", "CPU s", "effective draws, worst; median coordinate", "a CPU second")
    reached = "reached" if worst >= TIMES else "not reached"
    if min(row["ess_worst"] for row in rows) < RELIABLE:
        reached += f", as far as effective samples below {RELIABLE:.0f} can tell"
    goal = f"The goal of {TIMES:.0f} times NUTS in the worst coordinate: {reached} ({_pair(worst, median)} times)."
    return f"{markdown(header, shown)}\n\n{goal}"


def frame_samplers(tables: Tables) -> str:
    """Value of a gradient for each sampler of one frame, and whether one does better than the tempered filter."""
    rows = tables["frame_samplers"].records()
    shown = [
        [
            row["frame"],
            row["sampler"],
            f"{row['gradients']:,.0f}",
            f"{row['worth']:.0f}",
            f"{row['per_1000']:.1f} ± {row['per_1000_error']:.1f}",
            f"{row['evidence']:+.2f} ± {row['evidence_sd']:.2f}",
        ]
        for row in rows
    ]
    own = {row["frame"]: row for row in rows if row["sampler"] == "tempered filter"}
    better = [
        f"{row['sampler']} ({row['frame']})"
        for row in rows
        if row["per_1000"] - own[row["frame"]]["per_1000"]
        > 2 * math.hypot(row["per_1000_error"], own[row["frame"]]["per_1000_error"])
    ]
    header = ("frame", "sampler", "gradients", "independent draws", "for 1,000 gradients", "log-evidence, error")
    sentence = f"More than the tempered filter for a gradient, beyond two standard errors: {', '.join(better) or 'none'}."
    return f"{markdown(header, shown)}\n\n{sentence}"


def _pair(one: float, other: float) -> str:
    return "" if math.isnan(one) else f"{_number(one)}; {_number(other)}"


def _number(value: float) -> str:
    return f"{value:.3g}"
