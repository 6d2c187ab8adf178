"""Colours and canvas of the figures: pictures that need no display and show themselves in a notebook."""

from __future__ import annotations

import io
from os import PathLike

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from poseppl.files.atomic_writing import atomic_path

POSTERIOR = "#1f6f8b"
SAMPLE = "#6db3c9"
OBSERVED = "#e4572e"
TRUTH = "#1b1b1e"
BAND = "#cfe6ee"
GRID = "#e7e9ec"
TEXT = "#22262b"
MUTED = "#69727d"
GRAVE = "#b3261e"


class Picture(Figure):
    """A figure apart from pyplot: no global state, no window; a notebook shows it when it is the value of a cell."""

    def _repr_png_(self) -> bytes:
        return png(self)


def new_picture(width: float, height: float) -> Picture:
    """Make an empty picture.

    Args:
        width: Inches.
        height: Inches.

    Returns:
        The picture, laid out so that labels do not collide.
    """
    picture = Picture(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasAgg(picture)
    return picture


def png(picture: Figure, dpi: int = 120) -> bytes:
    """Render a picture.

    Args:
        picture: The picture.
        dpi: Dots an inch.

    Returns:
        The bytes of a PNG.
    """
    buffer = io.BytesIO()
    picture.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


def save_picture(picture: Figure, path: str | PathLike[str]) -> None:
    """Write a picture as PNG, whole or not at all.

    Args:
        picture: The picture.
        path: The file.

    Raises:
        InputError: The file cannot be written.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(png(picture))


def tidy(axes: Axes, title: str = "", xlabel: str = "", ylabel: str = "") -> None:
    """Give axes the house's look: light grid, no box, titles at the left.

    Args:
        axes: The axes.
        title: Title.
        xlabel: Label of the horizontal axis.
        ylabel: Label of the vertical axis.
    """
    axes.set_title(title, loc="left", fontsize=10.5, color=TEXT, fontweight="bold")
    axes.set_xlabel(xlabel, fontsize=9, color=MUTED)
    axes.set_ylabel(ylabel, fontsize=9, color=MUTED)
    axes.tick_params(labelsize=8, colors=MUTED, length=0)
    axes.grid(True, color=GRID, linewidth=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_visible(False)
