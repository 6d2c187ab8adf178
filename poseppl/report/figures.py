"""The summary picture of a run."""

from __future__ import annotations

import xarray as xr
from matplotlib.figure import Figure, FigureBase

from poseppl.diagnostics.selection import diagnosed, evenly, mean_points, variable
from poseppl.report.chains import draw_inefficiency, draw_state
from poseppl.report.error import draw_error
from poseppl.report.picture import MUTED, TEXT, new_picture
from poseppl.report.pose import draw_overlay, draw_pose3d, overlay_legend
from poseppl.runs.results import provenance

NUM_OVERLAYS = 5


def plot_track(tree: xr.DataTree) -> Figure:
    """Draw a run on one page: overlays of a few frames, a pose in space, the error over frames, the inefficiency factors.

    Args:
        tree: The result. One without a body shows its coordinates over the frames instead.

    Returns:
        The figure.
    """
    whole = diagnosed(tree)
    frames = whole["posterior"].sizes["frame"]
    images, body = mean_points(whole) is not None, variable(whole, "posterior", "markers") is not None
    picture = new_picture(14.0, 8.6)
    picture.suptitle(_title(whole), x=0.01, ha="left", fontsize=13, color=TEXT, fontweight="bold", parse_math=False)
    picture.set_layout_engine("constrained", h_pad=0.08, w_pad=0.06)
    grid = picture.add_gridspec(2, 1)
    upper, lower = picture.add_subfigure(grid[0]), picture.add_subfigure(grid[1])
    if images:
        for number, index in enumerate(evenly(frames, NUM_OVERLAYS)):
            draw_overlay(upper.add_subplot(1, NUM_OVERLAYS, number + 1), whole, int(index))
        upper.legend(handles=overlay_legend(), loc="outside lower center", ncols=3, fontsize=9, frameon=False, labelcolor=MUTED)
    else:
        _states(upper, whole, first=0)
    below = lower.add_gridspec(1, 3, width_ratios=(1.0, 1.35, 1.45))
    if body:
        draw_pose3d(lower.add_subplot(below[0], projection="3d"), whole, frames // 2)
        draw_error(lower.add_subplot(below[1]), whole)
    else:
        draw_state(lower.add_subplot(below[0:2]), whole, 0)
    draw_inefficiency(lower.add_subplot(below[2]), whole)
    return picture


def _states(row: FigureBase, tree: xr.DataTree, first: int) -> None:
    count = min(3, tree["posterior"].sizes["dof"] - first)
    for number in range(count):
        draw_state(row.add_subplot(1, count, number + 1), tree, first + number)


def _title(tree: xr.DataTree) -> str:
    known = provenance(tree)
    parts = [str(known[name]) for name in ("model", "filter", "smoother", "input") if name in known]
    return " · ".join([*parts, f"{tree['posterior'].sizes['frame']} frames"])
