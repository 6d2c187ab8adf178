"""Tables and charts of a body: errors by marker, cameras, joints of low confidence and every joint; its headline numbers."""

from __future__ import annotations

from itertools import cycle

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics.selection import provenance_table
from poseppl.motion.measures import expected_error
from poseppl.motion.verdicts.doubts import Doubts, doubts_in_a_row
from poseppl.motion.verdicts.residuals import ImageErrors
from poseppl.report.chart import Panel, Traces, chart, fan, line, stack
from poseppl.report.picture import MODES, OBSERVED, TRUTH
from poseppl.report.tables import Card, Row, Top, number_of
from poseppl.runs.contents import frame_numbers, names_of, variable
from poseppl.runs.results import provenance

MAX_DOUBTS = 15


def cards(tree: xr.DataTree) -> list[Card]:
    """List the headline numbers of a body, those that the result has."""
    stature = provenance(tree).get("assumed stature")
    tall, unsure = map(number_of, stature) if isinstance(stature, list) and len(stature) == 2 else (np.nan, np.nan)
    given = 0 < tall < 1e4 and 0 < unsure < 1e4
    error, relative = (variable(tree, "diagnostics", name) for name in ("joint_error", "joint_error_relative"))
    return [
        (error, "{:.0f} mm", "mean joint error"),
        (relative, "{:.0f} mm", "mean joint error relative to the root"),
        (tall / 1000 if given else None, f"{{:.2f}} ± {unsure / 1000:.2f} m", "assumed stature (± SD)"),
    ]


def error_table(tree: xr.DataTree) -> list[Row]:
    """List the error of each marker over the frames, absolute and relative to the root; nothing without a truth."""
    error, relative = variable(tree, "diagnostics", "joint_error"), variable(tree, "diagnostics", "joint_error_relative")
    if error is None or relative is None:
        return []
    parts = [*zip(names_of(tree, "marker"), error.T, relative.T, strict=True), ("all", error, relative)]
    return [
        {"marker": name, "mean": each.mean(), "high": np.quantile(each, 0.95), "relative": beside.mean()}
        for name, each, beside in parts
    ]


def camera_table(tree: xr.DataTree, errors: ImageErrors | None) -> list[Row]:
    """A row a camera: its data, their errors, and the correction of its calibration, if the result has these."""
    if errors is None:
        return []
    found, seen = provenance_table(tree, "cameras found"), np.isfinite(errors.distance)
    wrong_person, swaps = (variable(tree, "faults", part) for part in ("wrong_person", "swaps"))
    rows = []
    for c, (name, (right, down), spread) in enumerate(zip(errors.cameras, errors.bias, errors.spread, strict=True)):
        mine, noise = found.get(name), errors.noise[:, c][seen[:, c]]
        row: Row = {"camera": name, "points": seen[:, c].sum(), "noise": np.median(noise) if noise.size else np.nan}
        row |= {"spread": spread, "right": right, "down": down}
        if isinstance(mine, dict):
            row |= {key: number_of(mine.get(key)) for key in ("turned", "moved", "agreement")}
        if swaps is not None and swaps.size:
            row["exchanged"] = (swaps[:, c] > 0.5).any(-1).sum()
        if wrong_person is not None and np.isfinite(wrong_person[:, c]).any():
            row["identity"] = 1 - np.nanmax(wrong_person[:, c])
        rows.append(row)
    columns = {key for row in rows for key in row}
    return [dict.fromkeys(columns, np.nan) | row for row in rows]


def doubt_table(tree: xr.DataTree, doubts: Doubts | None) -> Top:
    """The doubts that weigh most."""
    found = [] if doubts is None else doubts_in_a_row(tree, doubts)
    rows: list[Row] = [
        each._asdict()
        | {
            "joint": ", ".join(each.joints),
            "frames": f"{each.first}" + (f" to {each.last}" if each.num_frames > 1 else ""),
        }
        for each in found[:MAX_DOUBTS]
    ]
    return Top(rows, len(found))


FEW_POINTS = 300


def error_traces(tree: xr.DataTree) -> Traces:
    """Mean joint error over frames on the 90 % band of errors that the posterior expects; nothing without markers.

    The band shows the distance of draws from their mean: where the posterior is calibrated the truth behaves as one more draw.
    """
    expected, error = expected_error(tree), variable(tree, "diagnostics", "joint_error")
    relative = variable(tree, "diagnostics", "joint_error_relative")
    if expected is None:
        return []
    x = frame_numbers(tree)
    traces = fan(x, expected, ("expected error, central 90 %", "expected error, median"), line_width=1.2)
    if error is not None and relative is not None:
        traces.append(line(x, error.mean(axis=1), "error", TRUTH))
        traces.append(line(x, relative.mean(axis=1), "error relative to the root", OBSERVED))
    return traces


def residual_chart(tree: xr.DataTree, errors: ImageErrors | None) -> go.Figure | None:
    """Median distance of each camera's points from where they are expected, over the frames."""
    if errors is None:
        return None
    x, middle = frame_numbers(tree), xr.DataArray(errors.distance, dims=("frame", "camera", "marker")).median("marker").values
    rows = zip(middle.T, errors.cameras, cycle(MODES), strict=False)
    traces = [line(x, *row, FEW_POINTS, line_width=1.4) for row in rows]
    return chart(traces, "distance, image units", height=260, showlegend=True)


def joint_charts(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """x, y and z of each joint over the frames on its interval, and how wide that is, by name."""
    mean, ends = variable(tree, "summary", "markers_mean"), variable(tree, "summary", "markers_quantile")
    truth = variable(tree, "truth", "markers")
    if mean is None or ends is None:
        return {}
    x, low, high, made = frame_numbers(tree), ends[:, 0], ends[:, -1], {}
    for k, name in enumerate(names_of(tree, "marker", "summary")):
        panels, widths = [], []
        for axis, label in enumerate("xyz"):
            at = (slice(None), k, axis)
            traces = fan(x, (low[at], mean[at], high[at]), most=FEW_POINTS, line_width=1.4)
            if truth is not None:
                traces.append(line(x, truth[at], "truth", TRUTH, FEW_POINTS, line_width=1.2))
            panels.append(Panel(traces, f"{label}, mm"))
            widths.append(line(x, (high[at] - low[at]) / 2, f"half-width, {label}", MODES[axis], FEW_POINTS, line_width=1.2))
        made[name] = stack([*panels, Panel(widths, "half-width, mm", {"rangemode": "tozero"})], height=120)
    return made
