"""Charts of the variance of the mean against time: one point a setting, one line a method."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array
from poseppl.report.chart import Chart, Traces, line, log_ticks
from poseppl.report.compare_tables import run_colors, run_labels


def variance_charts(tree: xr.DataTree) -> list[Chart]:
    """Draw the variance of the mean against time, one point a setting: of all coordinates together, and of each."""
    data, names = tree["variance"].dataset, tree["figures"].dataset["run"].values.tolist()
    usable = np.isfinite(data["seconds"].values) & (data["seconds"].values > 0)
    places = {"all coordinates": (data["variance"].values, data["variance_se"].values)}
    for dof, label in enumerate(data["dof"].values.tolist()):
        places[label] = (data["variance_by_dof"].values[:, dof], data["variance_by_dof_se"].values[:, dof])
    if not any((usable & (variance > 0)).any() for variance, _ in places.values()):
        return []
    first = [names.index(name) for name in data["setting"].values.tolist()]
    charts = []
    for place, (variance, error) in places.items():
        shown = usable & (np.nan_to_num(variance) > 0)
        charts.append({"label": place} | _variance(tree, np.where(shown, variance, np.nan), error, first))
    return charts


def _variance(tree: xr.DataTree, variance: Array, error: Array, first: list[int]) -> Chart:
    """One line a method through its settings, and through its best the line along which variance times time is the same."""
    data, labels, colors = tree["variance"].dataset, run_labels(tree), run_colors(tree["figures"].sizes["run"])
    seconds, seconds_error, seeds = (data[name].values for name in ("seconds", "seconds_se", "replicates"))
    wrong = tree["summary"].dataset["miscalibrated"].values[first]
    methods = [str(name) or labels[index] for name, index in zip(data["method"].values, first, strict=True)]
    traces: Traces = []
    for method in dict.fromkeys(methods):
        members = [i for i in np.argsort(seconds, kind="stable") if methods[i] == method and np.isfinite(variance[i])]
        if not members:
            continue
        color, mode = colors[first[members[0]]], "lines+markers" if len(members) > 1 else "markers"
        told = [f"{labels[first[i]]}, {f'{seeds[i]} seeds' if seeds[i] > 1 else 'one seed'}" for i in members]
        symbols = ["circle" if seeds[i] > 1 else "circle-open" for i in members]
        bars = {"error_x": _bars(seconds[members], seconds_error[members]), "error_y": _bars(variance[members], error[members])}
        name = f"{method} (miscalibrated)" if wrong[members].all() else method
        style = {"mode": mode, "text": told, "line": {"color": color, "width": 1}, "showlegend": True}
        style["marker"] = {"color": color, "size": 11, "line": {"width": 2, "color": color}, "symbol": symbols}
        style["hovertemplate"] = "%{text}<br>%{x:.3g} s a frame, variance %{y:.3g}<extra></extra>"
        traces.append(line(seconds[members], variance[members], name, color, **style, **bars))
    return {"data": traces, "layout": _variance_layout(traces)}


def _variance_layout(traces: Traces) -> dict[str, Any]:
    if not traces:
        return {"height": 430}
    x = np.concatenate([trace["x"] for trace in traces])
    ends = [trace["y"] + sign * trace["error_y"][side] for trace in traces for sign, side in ((1, "array"), (-1, "arrayminus"))]
    low, high = x.min() / 2, 2 * x.max()
    shared = {"type": "line", "x0": low, "x1": high, "layer": "below", "opacity": 0.5}
    costs = [(float(np.min(trace["x"] * trace["y"])), trace["line"]["color"]) for trace in traces]
    shapes = [
        shared | {"y0": k / low, "y1": k / high, "line": {"color": color, "width": 1, "dash": "dot"}} for k, color in costs
    ]
    axes = {
        "xaxis": _ticked("seconds a frame", x),
        "yaxis": _ticked("variance of the mean / posterior variance", np.concatenate(ends)),
    }
    return {"height": 430, "hovermode": "closest", "margin": {"l": 70, "r": 16, "t": 12, "b": 48}, "shapes": shapes} | axes


def _ticked(title: str, values: Array) -> dict[str, Any]:
    """A logarithmic axis around values, with ticks at 1, 3, 10, ..."""
    low, high = values.min() / 2, 2 * values.max()
    ticks = log_ticks(low, high)
    labels = {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return {"type": "log", "title": {"text": title}, "range": np.log10([low, high])} | labels


def _bars(values: Array, errors: Array) -> dict[str, Any]:
    """Both ends of a bar of two standard errors of the logarithm; none where the error is not known."""
    factor = np.exp(np.minimum(np.nan_to_num(2 * errors / values), 12))
    ends = {"array": values * (factor - 1), "arrayminus": values - values / factor}
    return {"type": "data", "symmetric": False, "thickness": 1.2, "width": 3} | ends
