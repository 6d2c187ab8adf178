"""Cameras and doubts as the report shows them: errors by camera, over the frames, and the joints not to trust."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.arrays import Integers
from poseppl.diagnostics.doubts import Doubts, doubts_in_a_row
from poseppl.diagnostics.image_errors import ImageErrors
from poseppl.diagnostics.selection import evenly
from poseppl.report.chart import Panel, band, chart, line, stack
from poseppl.report.picture import MODES, POSTERIOR, TRUTH
from poseppl.runs.contents import frame_numbers, names_of, variable
from poseppl.runs.results import provenance

MAX_POINTS, MAX_ROWS = 300, 15


def camera_table(tree: xr.DataTree, errors: ImageErrors | None) -> list[dict[str, Any]]:
    """A row a camera: what it saw, how far off, and how much its calibration was mended, where the result tells."""
    if errors is None:
        return []
    bias, spread, seen = errors.bias, errors.spread, np.isfinite(errors.distance)
    found = provenance(tree).get("cameras found")
    told = found if isinstance(found, dict) else {}
    wrong_person, swaps = (variable(tree, "faults", part) for part in ("wrong_person", "swaps"))
    rows = []
    for c, name in enumerate(errors.cameras):
        mine = told.get(name)
        mended = {key: _number(mine.get(key)) for key in ("turned", "moved", "agreement")} if isinstance(mine, dict) else {}
        noise = errors.noise[:, c][seen[:, c]]
        row = {
            "camera": name,
            "points": int(seen[:, c].sum()),
            "noise": float(np.median(noise)) if noise.size else np.nan,
            "spread": float(spread[c]),
            "right": float(bias[c, 0]),
            "down": float(bias[c, 1]),
        }
        if swaps is not None and swaps.size:
            mended["exchanged"] = int((swaps[:, c] > 0.5).any(-1).sum())
        if wrong_person is not None and np.isfinite(wrong_person[:, c]).any():
            mended["identity"] = 1 - float(np.nanmax(wrong_person[:, c]))
        rows.append(row | mended)
    columns = {key for row in rows for key in row}
    return [{key: row.get(key, np.nan) for key in columns} for row in rows]


def residual_chart(tree: xr.DataTree, errors: ImageErrors | None) -> go.Figure | None:
    """Median distance of each camera's points from where they are expected, over the frames."""
    if errors is None:
        return None
    chosen = evenly(len(errors.residual), MAX_POINTS)
    x = frame_numbers(tree)[chosen]
    distance = errors.distance[chosen]
    traces = []
    for c, name in enumerate(errors.cameras):
        known = np.isfinite(distance[:, c]).any(1)
        middle = np.full(len(chosen), np.nan)
        middle[known] = np.nanmedian(distance[known, c], axis=1)
        traces.append(line(x, middle, name, MODES[c % len(MODES)], line_width=1.4))
    return chart(traces, "image units", height=260, showlegend=True)


def joint_charts(tree: xr.DataTree) -> dict[str, go.Figure]:
    """x, y and z of each joint over the frames on its interval, and how wide that is, by name."""
    mean, ends = variable(tree, "summary", "markers_mean"), variable(tree, "summary", "markers_quantile")
    truth = variable(tree, "truth", "markers")
    if mean is None or ends is None:
        return {}
    half = (ends[:, -1] - ends[:, 0]) / 2
    chosen = evenly(len(mean), MAX_POINTS)
    x, made = frame_numbers(tree)[chosen], {}
    for k, name in enumerate(names_of(tree, "marker", "summary")):
        panels = []
        for axis, label in enumerate("xyz"):
            traces = band(x, ends[chosen, 0, k, axis], ends[chosen, -1, k, axis], "central 90 %")
            traces.append(line(x, mean[chosen, k, axis], "posterior mean", POSTERIOR, line_width=1.4))
            if truth is not None:
                traces.append(line(x, truth[chosen, k, axis], "truth", TRUTH, line_width=1.2))
            panels.append(Panel(traces, f"{label}, mm"))
        widths = [
            line(x, half[chosen, k, axis], f"of {label}", MODES[axis], line_width=1.2) for axis, label in enumerate("xyz")
        ]
        panels.append(Panel(widths, "±, mm", {"rangemode": "tozero"}))
        figure = stack(panels, height=120)
        if figure is not None:
            made[name] = figure
    return made


def doubt_table(tree: xr.DataTree, doubts: Doubts | None) -> list[dict[str, Any]]:
    """The doubts that weigh most."""
    rows = [] if doubts is None else doubts_in_a_row(tree, doubts)[:MAX_ROWS]
    return [each._asdict() | {"frames": f"{each.first}" + (f" to {each.last}" if each.num_frames > 1 else "")} for each in rows]


def doubts_shown(tree: xr.DataTree, doubts: Doubts | None, frames: Integers) -> dict[str, Any] | None:
    """Reasons (frame, marker) in some frames, and their words; None where nothing is doubted."""
    if doubts is None or (doubts.reasons < 0).all():
        return None
    return {"reasons": doubts.reasons[np.searchsorted(frame_numbers(tree), frames)], "words": doubts.words}


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")
