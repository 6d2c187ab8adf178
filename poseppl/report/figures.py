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

from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.selection import evenly, frame_index, segments
from poseppl.diagnostics.simulation_based import Calibration
from poseppl.report.chart import Panel
from poseppl.report.charts import (
    BINS,
    error_traces,
    histogram,
    inefficiency_panel,
    state_traces,
)
from poseppl.report.picture import GRID, MUTED, OBSERVED, POSTERIOR, SAMPLE, TEXT, TRUTH, new_picture
from poseppl.report.pose_data import pose_data
from poseppl.report.titles import algorithms_of, recording_of, wrapped
from poseppl.runs.contents import names_of

NUM_OVERLAYS = 5
TITLE_LETTERS = 110
"""Length of a line of a picture's title."""
MAX_RANKS = 24
WIDTH = 2.6
"""Standard errors of a bar of ranks: 99 %."""
_TITLE: dict[str, Any] = {"loc": "left", "fontsize": 10.5, "color": TEXT, "fontweight": "bold", "parse_math": False}


def plot_track(tree: xr.DataTree) -> Figure:
    """Draw a run on one page: overlays of a few frames, a pose in space, the error over frames, the inefficiency factors.

    A result without a body shows its coordinates over the frames instead.
    """
    whole = diagnosed(tree)
    poses = pose_data(whole, evenly(whole["posterior"].sizes["frame"], NUM_OVERLAYS)) or {"space": None, "image": None}
    picture = new_picture(14.0, 8.6)
    parts = [algorithms_of(whole), recording_of(whole), f"{whole['posterior'].sizes['frame']} frames"]
    title = wrapped(" · ".join(filter(None, parts)), TITLE_LETTERS)
    picture.suptitle(title, x=0.01, ha="left", fontsize=13, color=TEXT, fontweight="bold", parse_math=False)
    picture.set_layout_engine("constrained", h_pad=0.08, w_pad=0.06)
    rows = picture.add_gridspec(2, 1)
    upper, lower = (picture.add_subfigure(row) for row in (rows[0], rows[1]))
    if poses["image"] is not None:
        for number in range(len(poses["frames"])):
            axes = upper.add_subplot(1, NUM_OVERLAYS, number + 1)
            _overlay(axes, poses, number)
        handles = axes.get_legend_handles_labels()[0]
        upper.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False, labelcolor=MUTED)
    else:
        _draw_panels(upper, _state_panels(whole, names_of(whole, "state_dim")[:3]), columns=3)
    if poses["space"] is not None:
        sampled = is_sampled(whole)
        below = lower.add_gridspec(1, 3 if sampled else 2, width_ratios=(1.0, 1.35, 1.45) if sampled else (1.0, 2.8))
        _pose3d(lower.add_subplot(below[0], projection="3d"), poses, len(poses["frames"]) // 2)
        _error(lower.add_subplot(below[1]), whole)
        if sampled:
            _draw_panel(lower.add_subplot(below[2]), inefficiency_panel(whole))
    else:
        _draw_panels(lower, [inefficiency_panel(whole)])
    return picture


def plot_overlay(tree: xr.DataTree, frame: int | None = None, camera: int = 0) -> Figure:
    """Draw observed markers, the mean of the predicted ones and sampled skeletons in the image of a camera, by its index.

    Args:
        tree: The result.
        frame: The frame's number, of the middle one if None.
        camera: Index of the camera.

    Raises:
        ValueError: The result has no ``points``, or no such frame.
    """
    picture = new_picture(4.2, 5.0)
    axes = picture.add_subplot()
    _overlay(axes, pose_data(tree, np.array([frame_index(tree, frame)])), camera=camera)
    _legend(axes, loc="upper right")
    return picture


def plot_pose3d(tree: xr.DataTree, frame: int | None = None) -> Figure:
    """Draw sampled poses in space, their mean, and the truth where there is one, at a frame, the middle one if None.

    Raises:
        ValueError: The result has no ``markers``, or no such frame.
    """
    picture = new_picture(5.5, 5.5)
    _pose3d(picture.add_subplot(projection="3d"), pose_data(tree, np.array([frame_index(tree, frame)])))
    return picture


def plot_error(tree: xr.DataTree) -> Figure:
    """Draw the mean joint error; see :func:`poseppl.report.charts.error_traces`."""
    picture = new_picture(8.0, 3.4)
    _error(picture.add_subplot(), diagnosed(tree))
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
    _draw_panels(picture, panels, columns, xlabel)
    return picture


def _draw_panels(canvas: FigureBase, panels: Sequence[Panel], columns: int = 1, xlabel: str = "frame") -> None:
    columns = min(columns, len(panels))
    for number, panel in enumerate(panels, 1):
        _draw_panel(canvas.add_subplot(-(-len(panels) // columns), columns, number), panel, xlabel)


def _draw_panel(axes: Axes, panel: Panel, xlabel: str = "frame") -> None:
    """Draw a panel in the house's look: light grid, no box, titles at the left, where names of results are no formulae."""
    axes.set_title(panel.title, **_TITLE)
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


def _legend(axes: Axes, **where: Any) -> None:
    """Name what was drawn, if anything has a name."""
    if axes.get_legend_handles_labels()[0]:
        for text in axes.legend(fontsize=8, frameon=False, **where).get_texts():
            text.set_parse_math(False)


def _overlay(axes: Axes, poses: dict[str, Any] | None, number: int = 0, camera: int = 0) -> None:
    """Draw one of some frames (of :func:`poseppl.report.pose_data.pose_data`) in an image."""
    if poses is None or poses["image"] is None:
        raise ValueError("the result has no points: run with a model whose observation program declares them")
    image = poses["image"]
    _skeletons(axes, poses, image["draws"][number, :, camera], image["mean"][number, camera])
    axes.plot(*image["mean"][number, camera].T, ".", color=POSTERIOR, markersize=4)
    if image["observed"] is not None:
        seen = image["observed"][number, camera].T
        axes.plot(*seen, "o", color=OBSERVED, markerfacecolor="none", markersize=6, markeredgewidth=1.4, label="observed")
    (x, y), reach = image["centre"][number, camera], image["reach"][camera]
    ends = (y + reach, y - reach) if image["down"][camera] else (y - reach, y + reach)
    axes.set(xlim=(x - 0.8 * reach, x + 0.8 * reach), ylim=ends, aspect="equal", xticks=[], yticks=[])
    axes.set_title(f"frame {poses['frames'][number]}", loc="left", fontsize=9.5, color=TEXT)
    for spine in axes.spines.values():
        spine.set_color(GRID)


def _pose3d(axes: Any, poses: dict[str, Any] | None, number: int = 0) -> None:
    """Draw one of some frames in space, into 3-D axes."""
    if poses is None or poses["space"] is None:
        raise ValueError("the result has no markers: run with a model whose observation program declares them")
    space = poses["space"]
    _skeletons(axes, poses, space["draws"][number], space["mean"][number])
    axes.scatter(*space["mean"][number].T, color=POSTERIOR, s=9, depthshade=False)
    if space["truth"] is not None:
        axes.plot(*segments(space["truth"][number], poses["edges"]).T, color=TRUTH, linewidth=1.4, label="truth")
    x, y, z = space["centre"][number][:, None] + space["reach"] * np.array([-1, 1])
    axes.set(xlim=x, ylim=y, zlim=z)
    axes.set_box_aspect((1, 1, 1), zoom=1.15)
    axes.view_init(elev=14, azim=-58)
    axes.set_title(f"in space, frame {poses['frames'][number]} (mm)", **_TITLE)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 1))
        axis._axinfo["grid"].update(color=GRID, linewidth=0.7)
    axes.tick_params(labelsize=7, colors=MUTED, pad=-2)
    axes.locator_params(nbins=4)
    _legend(axes, loc="upper right")


def _skeletons(axes: Any, poses: dict[str, Any], draws: Any, mean: Any) -> None:
    samples = np.concatenate([segments(sample, poses["edges"]) for sample in draws])
    axes.plot(*samples.T, color=SAMPLE, linewidth=0.7, alpha=0.5, label="posterior draws")
    axes.plot(*segments(mean, poses["edges"]).T, color=POSTERIOR, linewidth=2.1, label="posterior mean")


def _state_panels(tree: xr.DataTree, names: Sequence[str]) -> list[Panel]:
    return [Panel(state_traces(tree, names_of(tree, "state_dim").index(name)), name) for name in names]


def _error(axes: Axes, tree: xr.DataTree) -> None:
    data = tree["diagnostics"].dataset
    title, told = "Uncertainty of the joints", []
    if "joint_error" in data:
        absolute, relative = (float(data[name].mean()) for name in ("joint_error", "joint_error_relative"))
        title, told = "Joint error", [f"mean {absolute:.0f} mm, relative {relative:.0f} mm"]
        told += [
            f"{100 * level:.0f} % intervals cover {100 * share:.0f} ± {100 * error:.0f} %"
            for level, share, error in zip(*(data.get(name, []) for name in ("level", "coverage", "coverage_se")), strict=False)
            if np.isfinite(share)
        ]
    _draw_panel(axes, Panel(error_traces(tree), title, {"title_text": "mm"}))
    axes.set_ylim(0, axes.get_ylim()[1] * 1.3)
    _legend(axes, loc="upper left")
    axes.text(0.995, 0.97, "\n".join(told), ha="right", va="top", transform=axes.transAxes, fontsize=8, color=MUTED)
