"""Charts as Plotly's figures, which the page draws, and whose traces :mod:`poseppl.report.figures` draws into a picture.

They contain names of results unchanged: the page's script escapes them for Plotly, which reads a few HTML tags.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from plotly import graph_objects as go
from plotly.subplots import make_subplots

from poseppl.diagnostics.selection import Array, evenly
from poseppl.report.picture import BAND, MUTED, POSTERIOR

Traces = list[go.Scatter]
MAX_POINTS = 600
INTERVAL = ("central 90 %", "posterior mean")
DOTTED: dict[str, Any] = {"line_width": 1, "line_dash": "dot", "hoverinfo": "skip"}


class Panel(NamedTuple):
    """One of several axes of a chart: its traces, its title, and what Plotly's axes are to have."""

    traces: Sequence[Any]
    title: str = ""
    yaxis: dict[str, Any] = {}
    xaxis: dict[str, Any] = {}
    color: str = ""
    """Colour of a dot before the title."""
    missing: str = ""
    """Why it is empty."""


def scatter(x: Any, y: Array, name: str, color: str, **more: Any) -> go.Scatter:
    """Draw points."""
    drawn = {"mode": "markers", "line_color": color, "line_width": 2, "marker_color": color}
    return go.Scatter(x=np.asarray(x), y=np.asarray(y, float), name=name, **drawn | more)


def line(x: Any, y: Array, name: str, color: str, most: int = MAX_POINTS, **more: Any) -> go.Scatter:
    """Draw a line through at most so many points, evenly chosen; a single point as a marker."""
    chosen = evenly(len(x), most)
    mode = {"mode": "lines" if len(x) > 1 else "markers"}
    return scatter(np.asarray(x)[chosen], np.asarray(y)[chosen], name, color, **mode | more)


def fan(x: Any, lines: Any, names: Sequence[str] = INTERVAL, colors: Sequence[str] = (BAND, POSTERIOR), **more: Any) -> Traces:
    """Draw an interval over x: the band between the first and the last of three lines, and the one in the middle."""
    (low, middle, high), (name, middle_name), (ground, color), most = lines, names, colors, more.pop("most", MAX_POINTS)
    ends: dict[str, Any] = {"line_width": 0, "mode": "lines", "hoverinfo": "skip", "most": most}
    upper = line(x, high, name, ground, fill="tonexty", fillcolor=ground, **ends)
    return [line(x, low, name, ground, showlegend=False, **ends), upper, line(x, middle, middle_name, color, most, **more)]


def points(x: Any, y: Array, name: str, color: str, error: Array) -> go.Scatter:
    """Draw points with bars of two standard errors."""
    return scatter(x, y, name, color, marker_size=9, error_y=bars(2 * np.asarray(error), color=color))


def bars(above: Array, below: Array | None = None, **style: Any) -> dict[str, Any]:
    """Describe the error bars of points, as long below as above if not given."""
    return {"array": above, "thickness": 1.5} | ({} if below is None else {"arrayminus": below, "symmetric": False}) | style


def heat(x: Any, names: Sequence[str], values: Array, label: str, run: str = "", *, logarithmic: bool) -> go.Heatmap:
    """Colour a grid (name, x), at evenly chosen x of many; the page takes the logarithm, ``meta`` says so."""
    chosen = evenly(len(x), MAX_POINTS)
    template = f"%{{y}}, frame %{{x}}<br>{label} %{{customdata:.3g}}<extra>%{{fullData.name}}</extra>"
    shown = {"meta": "log10"} if logarithmic else {"z": values[:, chosen]}
    drawn = {"name": run, "coloraxis": "coloraxis", "showlegend": False, "hovertemplate": template}
    return go.Heatmap(x=np.asarray(x)[chosen], y=list(names), customdata=values[:, chosen], **shown, **drawn)


def color_axis(low: float, high: float, label: str, *, logarithmic: bool = False, dark_is_bad: bool = True) -> dict[str, Any]:
    """Colours of heat maps: light is good, dark is bad."""
    bar: dict[str, Any] = {"title": {"text": label, "side": "right"}, "thickness": 12, "len": 1}
    if logarithmic:
        ticks = log_ticks(low, high)
        bar |= {"tickvals": np.log10(ticks), "ticktext": [f"{tick:g}" for tick in ticks]}
        low, high = np.log10(low), np.log10(high)
    return {"colorscale": "YlGnBu", "reversescale": not dark_is_bad, "colorbar": bar, "cmin": float(low), "cmax": float(high)}


def log_ticks(low: float, high: float) -> Array:
    """1, 3, 10, 30, ... between two ends, or powers of ten alone where they are far apart."""
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.log10(high) + 1)
    every = powers if np.log10(high / low) > 4 else np.stack([powers, 3 * powers], axis=1).ravel()
    return np.asarray([float(f"{tick:.3g}") for tick in every if 0.999 * low <= tick <= 1.001 * high])


def log_axis(title: str, values: Array) -> dict[str, Any]:
    """A logarithmic axis around what is positive of values, with ticks at 1, 3, 10, ..."""
    known = values[np.isfinite(values) & (values > 0)]
    low, high = known.min() / 2, 2 * known.max()
    ticks = log_ticks(low, high)
    labels = {"tickvals": ticks, "ticktext": [f"{tick:g}" for tick in ticks]}
    return {"type": "log", "title_text": title, "range": np.log10([low, high])} | labels


def chart(traces: Sequence[Any], ylabel: str, *, xlabel: str = "frame", height: int = 320, **layout: Any) -> go.Figure | None:
    """Make a chart of one pair of axes; none without traces."""
    axes = {"xaxis_title_text": xlabel, "yaxis_title_text": ylabel, "yaxis_rangemode": "tozero"}
    return go.Figure(traces).update_layout(axes | layout, height=height) if traces else None


def grid(panels: Sequence[Panel], *, columns: int, height: int, **layout: Any) -> go.Figure | None:
    """Make a chart of several axes with titles above them, row by row."""
    if not panels:
        return None
    full, rest = divmod(len(panels), columns)
    specs: list[list[Any]] = [[{}] * columns] * full + ([[{}] * rest + [None] * (columns - rest)] if rest else [])
    gap = (46 if any(panel.title for panel in panels) else 16) / height
    figure = make_subplots(len(specs), columns, specs=specs, vertical_spacing=gap, horizontal_spacing=0.12 / columns**2)
    for number, panel in enumerate(panels):
        row, col = number // columns + 1, number % columns + 1
        figure.add_traces(panel.traces, row, col)
        figure.update_xaxes(panel.xaxis, row=row, col=col).update_yaxes(panel.yaxis, row=row, col=col)
        place = {"row": row, "col": col, "xref": "x domain", "yref": "y domain", "showarrow": False}
        above = place | {"x": 0, "y": 1, "xanchor": "left", "yanchor": "bottom"}
        if panel.color:
            figure.add_annotation(text="●", font_color=panel.color, **above)
        if panel.title:
            figure.add_annotation(text=panel.title, font_size=12, xshift=14 if panel.color else 0, **above)
        if panel.missing:
            figure.add_annotation(text=panel.missing, x=0.5, y=0.5, font_color=MUTED, **place)
    return _named_once(figure).update_layout(height=height, **layout)


def stack(panels: Sequence[Panel], *, height: int, **layout: Any) -> go.Figure | None:
    """Make a chart of panels of a height each, one below the other over the frames, with titles beside them."""
    if not panels:
        return None
    figure = make_subplots(len(panels), shared_xaxes=True, vertical_spacing=0.09 / len(panels))
    for row, panel in enumerate(panels, 1):
        figure.add_traces(panel.traces, row, 1)
        figure.update_yaxes(panel.yaxis, row=row, title_text=panel.title, title_font_size=11, automargin=True)
    figure.update_xaxes(title_text="frame", row=len(panels))
    return _named_once(figure).update_layout(height=60 + height * len(panels), **layout)


def _named_once(figure: go.Figure) -> go.Figure:
    """A name stands in the legend once."""
    named: set[str] = set()
    for trace in figure.data:
        shown = trace.showlegend is not False and trace.name not in named
        trace.update(legendgroup=trace.name, showlegend=shown)
        named |= {trace.name} if shown else set()
    return figure


def coverage_chart(rows: Sequence[go.Scatter], **layout: Any) -> go.Figure | None:
    """Draw coverage against the nominal level, in per cent, beside the diagonal."""
    ideal = line([40, 100], np.array([40.0, 100.0]), "ideal", MUTED, **DOTTED)
    axes: dict[str, Any] = {"xaxis_range": [44, 97], "xaxis_tickvals": [50, 80, 90], "yaxis_range": [0, 102]}
    traces = [ideal, *rows] if rows else []
    return chart(traces, "truth inside (%)", xlabel="nominal level (%)", hovermode="closest", **axes, **layout)
