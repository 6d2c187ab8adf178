"""Charts as Plotly's plain data and layout, which the page draws, and :func:`poseppl.report.picture.draw` into a picture.

Names of results stand in them as they are: the page's script escapes them for Plotly, which reads a few HTML tags.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from poseppl.diagnostics.selection import Array
from poseppl.report.picture import BAND, MUTED

Chart = dict[str, Any]
Traces = list[dict[str, Any]]


class Panel(NamedTuple):
    """One of several axes of a chart: its traces, its title, and what Plotly's axes are to have."""

    traces: Traces
    title: str = ""
    yaxis: dict[str, Any] = {}
    xaxis: dict[str, Any] = {}
    color: str = ""
    """Of a dot before the title."""
    missing: str = ""
    """Why it is empty."""


def line(x: Any, y: Array, name: str, color: str, **more: Any) -> dict[str, Any]:
    """Draw a line; a single point as a marker."""
    drawn = {"mode": "lines" if len(x) > 1 else "markers", "line": {"color": color, "width": 2}, "marker": {"color": color}}
    return {"type": "scatter", "x": np.asarray(x), "y": np.asarray(y, float), "name": name} | drawn | more


def band(x: Any, low: Array, high: Array, name: str, color: str = BAND) -> Traces:
    """Fill what lies between two lines."""
    ends = line(x, low, name, color, line={"width": 0, "color": color}, mode="lines", hoverinfo="skip")
    return [ends | {"showlegend": False}, ends | {"y": np.asarray(high, float), "fill": "tonexty", "fillcolor": color}]


def points(x: Any, y: Array, name: str, color: str, error: Array, **more: Any) -> dict[str, Any]:
    """Draw points with bars of two standard errors."""
    bars = {"type": "data", "array": 2 * np.asarray(error), "color": color, "thickness": 1.5}
    return line(x, y, name, color, mode="markers", marker={"size": 9, "color": color}, error_y=bars, **more)


def heat(x: Any, names: Sequence[str], values: Array, label: str, *, logarithmic: bool) -> dict[str, Any]:
    """Colour a grid (name, x); the page takes the logarithm, ``meta`` says so."""
    told = f"%{{y}}, frame %{{x}}<br>{label} %{{customdata:.3g}}<extra>%{{fullData.name}}</extra>"
    trace = {"type": "heatmap", "x": np.asarray(x), "y": list(names), "customdata": values, "showlegend": False}
    return trace | {"hovertemplate": told} | ({"meta": "log10"} if logarithmic else {"z": values})


def color_axis(low: float, high: float, label: str, *, logarithmic: bool = False, dark_is_bad: bool = True) -> dict[str, Any]:
    """Colours of heat maps: light is good, dark is bad."""
    bar: dict[str, Any] = {"title": {"text": label, "side": "right"}, "thickness": 12, "len": 1}
    if logarithmic:
        ticks = log_ticks(low, high)
        bar |= {"tickvals": np.log10(ticks), "ticktext": [f"{tick:g}" for tick in ticks]}
        low, high = np.log10(low), np.log10(high)
    return {"colorscale": "YlGnBu", "reversescale": dark_is_bad, "colorbar": bar, "cmin": float(low), "cmax": float(high)}


def log_ticks(low: float, high: float) -> Array:
    """1, 3, 10, 30, ... between two ends, or powers of ten alone where they are far apart."""
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.log10(high) + 1)
    every = powers if np.log10(high / low) > 4 else np.stack([powers, 3 * powers], axis=1).ravel()
    return np.asarray([float(f"{tick:.3g}") for tick in every if 0.999 * low <= tick <= 1.001 * high])


def log_axis(values: Any) -> dict[str, Any]:
    """A logarithmic axis with labels at powers of ten, at 2 and 5 times them, too, where it is short."""
    known = np.asarray(values, float)
    known = known[np.isfinite(known) & (known > 0)]
    short = known.size == 0 or np.log10(known.max() / known.min()) < 2
    return {"type": "log", "dtick": "D2" if short else 1, "exponentformat": "power"}


def chart(traces: Traces, ylabel: str, *, xlabel: str = "frame", height: int = 320, **layout: Any) -> Chart | None:
    """Make a chart of one pair of axes; none without traces."""
    axes = {"xaxis": {"title": {"text": xlabel}}, "yaxis": {"title": {"text": ylabel}, "rangemode": "tozero"}}
    merged = {name: axes[name] | layout.pop(name, {}) for name in axes}
    return {"data": traces, "layout": {"height": height} | merged | layout} if traces else None


def grid(panels: Sequence[Panel], *, columns: int, height: int, shared: bool = False, **layout: Any) -> Chart | None:
    """Make a chart of several axes, row by row; with ``shared``, one below the other over one horizontal axis."""
    if not panels:
        return None
    suffixes = [str(number) if number > 1 else "" for number in range(1, len(panels) + 1)]
    across = ["" if shared else suffix for suffix in suffixes]
    data: Traces = []
    notes: Traces = []
    axes: dict[str, Any] = {}
    for panel, x, y in zip(panels, across, suffixes, strict=True):
        named = {trace["name"] for trace in data}
        data += [
            trace | {"xaxis": f"x{x}", "yaxis": f"y{y}", "legendgroup": trace["name"]} | _once(trace, named)
            for trace in panel.traces
        ]
        axes |= {f"xaxis{x}": panel.xaxis, f"yaxis{y}": panel.yaxis}
        where: dict[str, Any] = {"xref": f"x{x} domain", "yref": f"y{y} domain", "showarrow": False}
        if panel.title:
            dot: Traces = [{"text": "●", "font": {"color": panel.color}, "xshift": 0}] if panel.color else []
            title: dict[str, Any] = {"text": panel.title, "font": {"size": 12}, "xshift": 14 if dot else 0}
            top: dict[str, Any] = {"x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom"}
            notes += [where | top | each for each in (*dot, title)]
        if panel.missing:
            notes.append(where | {"text": panel.missing, "x": 0.5, "y": 0.5, "font": {"color": MUTED}})
    rows = -(-len(panels) // columns)
    cells = [f"x{x}y{y}" for x, y in zip(across, suffixes, strict=True)] + [""] * (rows * columns - len(panels))
    gap = (46 if any(panel.title for panel in panels) else 16) * rows / height
    laid = {
        "subplots": [cells[row * columns : (row + 1) * columns] for row in range(rows)],
        "ygap": gap,
        "xgap": 0.12 / columns,
    }
    return {"data": data, "layout": {"height": height, "grid": laid, "annotations": notes} | axes | layout}


def _once(trace: dict[str, Any], named: set[str]) -> dict[str, Any]:
    """A name stands in the legend once."""
    return {"showlegend": trace.get("showlegend", True) and trace["name"] not in named}


def coverage_chart(rows: Sequence[dict[str, Any]], **layout: Any) -> Chart | None:
    """Draw coverage against the nominal level, in per cent, beside the diagonal."""
    ideal = line([40, 100], np.array([40.0, 100.0]), "ideal", MUTED, line={"color": MUTED, "width": 1, "dash": "dot"})
    axes: dict[str, Any] = {"xaxis": {"range": [44, 97], "tickvals": [50, 80, 90]}, "yaxis": {"range": [0, 102]}}
    traces = [ideal | {"hoverinfo": "skip"}, *rows] if rows else []
    return chart(traces, "truth inside (%)", xlabel="nominal level (%)", hovermode="closest", **axes, **layout)
