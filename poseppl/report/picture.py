"""Colours of all figures, and the canvas of pictures, which need no display and show themselves in a notebook."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from poseppl.errors import FilePath
from poseppl.files.atomic_writing import write_atomically

POSTERIOR = "#1f6f8b"
SAMPLE = "#6db3c9"
OBSERVED = "#e4572e"
TRUTH = "#1b1b1e"
BAND = "#cfe6ee"
GRID = "#e7e9ec"
TEXT = "#22262b"
MUTED = "#69727d"
MODES = ("#882255", "#e69f00", "#44aa99", "#d6b0d8")


class Picture(Figure):
    """A figure apart from pyplot: no global state, no window; a notebook shows it when it is the value of a cell."""

    def _repr_png_(self) -> bytes:
        return png(self)


def new_picture(width: float, height: float) -> Picture:
    """Make an empty picture of so many inches, laid out so that labels do not collide."""
    picture = Picture(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(picture)
    return picture


def png(picture: Figure, dpi: int = 120) -> bytes:
    """Render a picture as the bytes of a PNG, at so many dots an inch."""
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def save_picture(picture: Figure, path: FilePath) -> None:
    """Write a picture as PNG, whole or not at all.

    Raises:
        InputError: The file cannot be written.
    """
    write_atomically(path, png(picture))


def tidy(axes: Axes, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Give axes the house's look: light grid, no box, titles at the left, where names of results are text and no formulae."""
    axes.set_title(title, loc="left", fontsize=10.5, color=TEXT, fontweight="bold", parse_math=False)
    axes.set_xlabel(xlabel, fontsize=9, color=MUTED)
    axes.set_ylabel(ylabel, fontsize=9, color=MUTED)
    axes.tick_params(labelsize=8, colors=MUTED, length=0)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw(axes: Axes, traces: Sequence[Any]) -> None:
    """Draw the lines and bands of a chart (:mod:`poseppl.report.chart`) into axes."""
    low: Any = 0.0
    for trace in traces:
        label = trace.name if trace.showlegend is not False else None
        if trace.fill:
            axes.fill_between(trace.x, low, trace.y, color=trace.fillcolor, linewidth=0, label=label)
        elif trace.line.width:
            form = "o" if trace.mode == "markers" else {"dash": "--", "dot": ":"}.get(trace.line.dash, "-")
            axes.plot(trace.x, trace.y, form, color=trace.line.color, linewidth=0.8 * trace.line.width, label=label)
        low = trace.y


def draw_legend(axes: Axes, **where: Any) -> None:
    """Name what was drawn, if anything has a name."""
    if axes.get_legend_handles_labels()[0]:
        for text in axes.legend(fontsize=8, frameon=False, **where).get_texts():
            text.set_parse_math(False)


def draw_heat(axes: Axes, trace: Any, high: float) -> None:
    """Draw a logarithmic heat map from 1 to an upper end of the colours."""
    x, names = trace.x, trace.y
    extent = (x[0] - 0.5, x[-1] + 0.5, len(names) - 0.5, -0.5)
    norm = LogNorm(1, high, clip=True)
    image = axes.imshow(trace.customdata, aspect="auto", cmap="YlGnBu", norm=norm, extent=extent, interpolation="nearest")
    axes.grid(False)
    axes.set_yticks(range(len(names)), names, fontsize=6.5 if len(names) > 12 else 8, parse_math=False)
    figure = axes.get_figure()
    if figure is not None:
        bar = figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04)
        bar.ax.tick_params(labelsize=7, colors=MUTED, length=0)
        bar.outline.set_visible(False)
