"""The charts of a body: joint errors, residuals of each camera, and every joint over the frames."""

from __future__ import annotations

from itertools import cycle

import xarray as xr
from plotly import graph_objects as go

from poseppl.motion.poses import expected_error
from poseppl.motion.verdicts.image_errors import ImageErrors
from poseppl.report.chart import Panel, Traces, chart, fan, line, stack
from poseppl.report.picture import MODES, OBSERVED, TRUTH
from poseppl.runs.contents import frame_numbers, names_of, variable

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
