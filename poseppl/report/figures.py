"""Figures of a result as pictures, one call each: the panels and poses of the report, drawn by matplotlib.

Traces, ranks and autocorrelations are ArviZ's to draw: ``arviz.plot_trace(poseppl.to_arviz(result), coords={"frame": [3]})``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure, FigureBase

from poseppl.diagnostics.diagnosis import diagnosed, extension_of
from poseppl.diagnostics.simulation_based import Calibration
from poseppl.report.chart import Panel
from poseppl.report.charts import BINS, algorithms_of, histogram, inefficiency_panel, recording_of, state_traces, wrapped
from poseppl.report.picture import GRID, MUTED, TEXT, new_picture
from poseppl.runs.contents import names_of

TITLE_LETTERS = 110
"""Length of a line of a picture's title."""
MAX_RANKS = 24
WIDTH = 2.6
"""Standard errors of a bar of ranks: 99 %."""
TITLE: dict[str, Any] = {"loc": "left", "fontsize": 10.5, "color": TEXT, "fontweight": "bold", "parse_math": False}


def plot_track(tree: xr.DataTree) -> Figure:
    """Draw a run on one page: its first coordinates and inefficiency factors over the frames, or what an extension draws."""
    whole = diagnosed(tree)
    picture = new_picture(14.0, 8.6)
    parts = [algorithms_of(whole), recording_of(whole), f"{whole['posterior'].sizes['frame']} frames"]
    title = wrapped(" · ".join(filter(None, parts)), TITLE_LETTERS)
    picture.suptitle(title, x=0.01, ha="left", fontsize=13, color=TEXT, fontweight="bold", parse_math=False)
    picture.set_layout_engine("constrained", h_pad=0.08, w_pad=0.06)
    rows = picture.add_gridspec(2, 1)
    upper, lower = (picture.add_subfigure(row) for row in (rows[0], rows[1]))
    extension = extension_of(whole, "report")
    if extension is None:
        draw_coordinates(upper, whole)
        draw_panel(lower.add_subplot(), inefficiency_panel(whole))
    else:
        extension.draw_track(upper, lower, whole)
    return picture


def plot_inefficiency(tree: xr.DataTree) -> Figure:
    """Draw inefficiency factors of every frame and coordinate; for weighted particles their effective number over frames."""
    return _picture([inefficiency_panel(diagnosed(tree))], 8.0, 2.2 + 0.16 * len(names_of(tree, "state_dim")))


def plot_state(tree: xr.DataTree, dofs: Sequence[str] | None = None) -> Figure:
    """Draw mean, central 90 % interval and truth of coordinates over the frames, by default of the first four."""
    return _picture(_state_panels(tree, names_of(tree, "state_dim")[:4] if dofs is None else dofs), 8.0, 1.9)


def plot_ranks(calibration: Calibration) -> Figure:
    """Draw the ranks' histograms of the first 24 coordinates, each bar with an interval of 99 % from the simulations' spread.

    Heaped at both ends the posterior is too narrow, in the middle too wide, at one end off to the other side.
    """
    panels = []
    for name, of_simulations in zip(calibration.names[:MAX_RANKS], np.moveaxis(calibration.ranks, -1, 0), strict=False):
        each = np.array([np.histogram(ranks, BINS, (0, 1))[0] for ranks in of_simulations])
        shares = each / each.sum(1, keepdims=True)
        error = WIDTH * shares.std(0, ddof=1) / np.sqrt(len(shares))
        panels.append(Panel(histogram(shares.mean(0), error, "ranks", "ideal"), name))
    return _picture(panels, 3.2, 2.4, columns=4, xlabel="rank of the truth")


def _picture(panels: Sequence[Panel], width: float, height: float, columns: int = 1, xlabel: str = "frame") -> Figure:
    """Draw panels of so many inches each."""
    columns = min(columns, len(panels))
    picture = new_picture(width * columns, height * -(-len(panels) // columns))
    draw_panels(picture, panels, columns, xlabel)
    return picture


def draw_panels(canvas: FigureBase, panels: Sequence[Panel], columns: int = 1, xlabel: str = "frame") -> None:
    """Draw panels, row by row."""
    columns = min(columns, len(panels))
    for number, panel in enumerate(panels, 1):
        draw_panel(canvas.add_subplot(-(-len(panels) // columns), columns, number), panel, xlabel)


def draw_panel(axes: Axes, panel: Panel, xlabel: str = "frame") -> None:
    """Draw a panel in the common style: light grid, no box, titles at the left, where names of results are no formulae."""
    axes.set_title(panel.title, **TITLE)
    axes.set_xlabel(xlabel, fontsize=9, color=MUTED)
    axes.set_ylabel(panel.yaxis.get("title_text", ""), fontsize=9, color=MUTED)
    axes.tick_params(labelsize=8, colors=MUTED, length=0)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
    low: Any = 0.0
    for trace in panel.traces:
        label = trace.name if trace.showlegend is not False else None
        if trace.type == "heatmap":
            _draw_heat(axes, trace)
        elif trace.type == "bar":
            style = {"color": trace.marker.color, "edgecolor": trace.marker.line.color, "ecolor": trace.error_y.color}
            axes.bar(trace.x, trace.y, trace.width, yerr=trace.error_y.array, label=label, **style)
        elif trace.fill:
            axes.fill_between(trace.x, low, trace.y, color=trace.fillcolor, linewidth=0, label=label)
        elif trace.line.width:
            form = "o" if trace.mode == "markers" else {"dash": "--", "dot": ":"}.get(trace.line.dash, "-")
            axes.plot(trace.x, trace.y, form, color=trace.line.color, linewidth=0.8 * trace.line.width, label=label)
        low = trace.y
    if panel.yaxis.get("type") == "log":
        axes.set(yscale="log", ylim=np.power(10.0, panel.yaxis["range"]))
        axes.minorticks_off()
    axes.text(0.5, 0.5, panel.missing, ha="center", va="center", transform=axes.transAxes, color=MUTED)


def _draw_heat(axes: Axes, trace: Any) -> None:
    """Draw a logarithmic heat map from 1 to its largest value, at least 10."""
    (x, names), high = (trace.x, trace.y), max(10.0, np.nanmax(trace.customdata))
    extent = (x[0] - 0.5, x[-1] + 0.5, len(names) - 0.5, -0.5)
    norm = LogNorm(1, high, clip=True)
    image = axes.imshow(trace.customdata, aspect="auto", cmap="YlGnBu", norm=norm, extent=extent, interpolation="nearest")
    axes.grid(False)
    axes.set_yticks(range(len(names)), names, fontsize=6.5 if len(names) > 12 else 8, parse_math=False)
    bar = axes.figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04)
    bar.ax.tick_params(labelsize=7, colors=MUTED, length=0)
    bar.outline.set_visible(False)


def legend(axes: Axes, **where: Any) -> None:
    """Name what was drawn, if anything has a name."""
    if axes.get_legend_handles_labels()[0]:
        for text in axes.legend(fontsize=8, frameon=False, **where).get_texts():
            text.set_parse_math(False)


def draw_coordinates(canvas: FigureBase, tree: xr.DataTree) -> None:
    """Draw the first three coordinates over the frames."""
    draw_panels(canvas, _state_panels(tree, names_of(tree, "state_dim")[:3]), columns=3)


def _state_panels(tree: xr.DataTree, names: Sequence[str]) -> list[Panel]:
    return [Panel(state_traces(tree, names_of(tree, "state_dim").index(name)), name) for name in names]
