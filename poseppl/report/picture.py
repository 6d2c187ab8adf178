"""Colours of all figures, and the canvas of pictures, which need no display and show themselves in a notebook."""

from __future__ import annotations

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
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
