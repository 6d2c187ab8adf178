"""Charts of the variance of the mean against time: one point a setting, one line a method."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics.selection import Array
from poseppl.report.chart import Traces, bars, line, log_ticks
from poseppl.report.compare_tables import shown_runs


def variance_charts(tree: xr.DataTree) -> dict[str, go.Figure]:
    """Draw the variance of the mean against time, one point a setting: of all coordinates together, and of each."""
    data = tree["variance"].dataset
    usable = np.isfinite(data["seconds"].values) & (data["seconds"].values > 0)
    places = {"all coordinates": (data["variance"].values, data["variance_se"].values)}
    for dof, label in enumerate(data["dof"].values.tolist()):
        places[label] = (data["variance_by_dof"].values[:, dof], data["variance_by_dof_se"].values[:, dof])
    shown = {place: usable & (np.nan_to_num(variance) > 0) for place, (variance, _) in places.items()}
    if not any(each.any() for each in shown.values()):
        return {}
    return {
        place: _variance(tree, np.where(shown[place], variance, np.nan), error) for place, (variance, error) in places.items()
    }


def _variance(tree: xr.DataTree, variance: Array, error: Array) -> go.Figure:
    """One line a method through its settings, and through its best the line along which variance times time is the same."""
    data, runs = tree["variance"].dataset, {run.name: run for run in shown_runs(tree)}
    first = [runs[name] for name in data["setting"].values.tolist()]
    seconds, seconds_error, seeds = (data[name].values for name in ("seconds", "seconds_se", "replicates"))
    methods = [str(name) or run.label for name, run in zip(data["method"].values, first, strict=True)]
    traces: Traces = []
    for method in dict.fromkeys(methods):
        members = [i for i in np.argsort(seconds, kind="stable") if methods[i] == method and np.isfinite(variance[i])]
        if not members:
            continue
        color = first[members[0]].color
        style: dict[str, Any] = {
            "mode": "lines+markers" if len(members) > 1 else "markers",
            "line_width": 1,
            "marker": {"size": 11, "line": {"width": 2, "color": color}, "color": color},
            "marker_symbol": ["circle" if seeds[i] > 1 else "circle-open" for i in members],
            "text": [f"{first[i].label}, {f'{seeds[i]} seeds' if seeds[i] > 1 else 'one seed'}" for i in members],
            "hovertemplate": "%{text}<br>%{x:.3g} s a frame, variance %{y:.3g}<extra></extra>",
            "error_x": _bars(seconds[members], seconds_error[members]),
            "error_y": _bars(variance[members], error[members]),
            "showlegend": True,
        }
        name = f"{method} (miscalibrated)" if all(first[i].label != first[i].name for i in members) else method
        traces.append(line(seconds[members], variance[members], name, color, **style))
    return go.Figure(traces, _variance_layout(traces))


def _variance_layout(traces: Traces) -> dict[str, Any]:
    if not traces:
        return {"height": 430}
    x = np.concatenate([trace.x for trace in traces])
    ends = [end for trace in traces for end in (trace.y + trace.error_y.array, trace.y - trace.error_y.arrayminus)]
    low, high = x.min() / 2, 2 * x.max()
    shared = {"type": "line", "x0": low, "x1": high, "layer": "below", "opacity": 0.5, "line_width": 1, "line_dash": "dot"}
    costs = [(float(np.min(trace.x * trace.y)), trace.line.color) for trace in traces]
    return {
        "height": 430,
        "hovermode": "closest",
        "margin": {"l": 70, "r": 16, "t": 12, "b": 48},
        "shapes": [shared | {"y0": cost / low, "y1": cost / high, "line_color": color} for cost, color in costs],
        "xaxis": _ticked("seconds a frame", x),
        "yaxis": _ticked("variance of the mean / posterior variance", np.concatenate(ends)),
    }


def _ticked(title: str, values: Array) -> dict[str, Any]:
    """A logarithmic axis around values, with ticks at 1, 3, 10, ..."""
    low, high = values.min() / 2, 2 * values.max()
    ticks = log_ticks(low, high)
    labels = {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return {"type": "log", "title_text": title, "range": np.log10([low, high])} | labels


def _bars(values: Array, errors: Array) -> dict[str, Any]:
    """Both ends of a bar of two standard errors of the logarithm; none where the error is not known."""
    factor = np.exp(np.minimum(np.nan_to_num(2 * errors / values), 12))
    return bars(values * (factor - 1), values - values / factor, thickness=1.2, width=3)
