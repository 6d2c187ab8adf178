"""Parts of the interactive charts, as Plotly's plain data and layout."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseppl.diagnostics.selection import Array
from poseppl.report.picture import GRID, TEXT

Chart = dict[str, Any]
AXIS = {"gridcolor": GRID, "zeroline": False, "linecolor": GRID}


def layout_of(ylabel: str, height: int = 320, **more: Any) -> dict[str, Any]:
    """Lay out a chart over the frames.

    Args:
        ylabel: Label of the vertical axis.
        height: Pixels.
        more: What is added to the layout, or replaces a part of it.
    """
    return {
        "height": height,
        "margin": {"l": 60, "r": 16, "t": 12, "b": 44},
        "paper_bgcolor": "white",
        "plot_bgcolor": "white",
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": TEXT},
        "xaxis": AXIS | {"title": {"text": "frame"}},
        "yaxis": AXIS | {"title": {"text": ylabel}, "rangemode": "tozero"},
        "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0},
        "hovermode": "x unified",
    } | more


def line(x: list[Any], y: Array, name: str, color: str, **more: Any) -> dict[str, Any]:
    """Draw a line; a single point as a marker.

    Args:
        x: Horizontal places.
        y: (point,).
        name: In the legend.
        color: Of the line.
        more: What is added, or replaced.
    """
    mode = "lines" if len(x) > 1 else "markers"
    return {"type": "scatter", "mode": mode, "x": x, "y": plain(y), "name": name, "line": {"color": color, "width": 2}} | more


def escaped(text: str) -> str:
    """Text for a label: Plotly reads a few HTML tags there."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def plain(values: Array, digits: int = 5) -> Any:
    """Nested lists of so many significant figures, with None for what is not finite: JSON knows no NaN."""
    if values.ndim > 1:
        return [plain(row, digits) for row in values]
    return [float(f"{value:.{digits}g}") if np.isfinite(value) else None for value in values]
