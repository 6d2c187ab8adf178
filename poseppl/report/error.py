"""The picture of the error over the frames, against what the posterior itself expects."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from poseppl.diagnostics.selection import diagnosed, expected_error, frame_numbers, variable
from poseppl.report.picture import BAND, MUTED, OBSERVED, POSTERIOR, TRUTH, new_picture, tidy


def plot_error(tree: xr.DataTree) -> Figure:
    """Draw the mean joint error over frames, with the 90 % band of errors that the posterior expects.

    The band holds the distance of draws from their mean: where the posterior is calibrated the truth behaves as one more draw.

    Args:
        tree: The result; without a truth the band alone is drawn.

    Returns:
        The figure.
    """
    picture = new_picture(8.0, 3.4)
    draw_error(picture.add_subplot(), diagnosed(tree))
    return picture


def draw_error(axes: Axes, tree: xr.DataTree) -> None:
    """Draw the error into given axes; see :func:`plot_error`.

    Args:
        axes: The axes.
        tree: A diagnosed result.
    """
    frames, band = frame_numbers(tree), expected_error(tree)
    error, relative = variable(tree, "diagnostics", "joint_error"), variable(tree, "diagnostics", "joint_error_relative")
    tidy(axes, "Joint error" if error is not None else "Uncertainty of the joints", "frame", "mm")
    if band is not None:
        axes.fill_between(frames, band[0], band[2], color=BAND, linewidth=0, label="posterior expects (90 %)")
        axes.plot(frames, band[1], color=POSTERIOR, linewidth=1.0, label="posterior expects (median)")
    if error is not None and relative is not None:
        axes.plot(frames, error.mean(axis=1), color=TRUTH, linewidth=1.8, label="error against the truth")
        axes.plot(frames, relative.mean(axis=1), color=OBSERVED, linewidth=1.3, label="error relative to the root")
        axes.text(0.995, 0.97, _caption(tree), ha="right", va="top", transform=axes.transAxes, fontsize=8, color=MUTED)
    axes.set_ylim(0, axes.get_ylim()[1] * 1.3)
    if len(frames) == 1:
        for line in axes.get_lines():
            line.set_marker("o")
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=7.5, frameon=False, loc="upper left", ncols=1)


def _caption(tree: xr.DataTree) -> str:
    data = tree["diagnostics"].dataset
    lines = [f"mean {float(data['joint_error'].mean()):.0f} mm, relative {float(data['joint_error_relative'].mean()):.0f} mm"]
    if "coverage" in data:
        for level, share, error in zip(data["level"].values, data["coverage"].values, data["coverage_se"].values, strict=True):
            if np.isfinite(share):
                lines.append(f"{100 * level:.0f} % intervals cover {100 * share:.0f} ± {100 * error:.0f} %")
    return "\n".join(lines)
