"""Figures of a result as pictures, one call each: the report's charts and poses, drawn by matplotlib.

ArviZ's own plots take a result as it is (``arviz_plots.plot_rank(tree, var_names="state", coords={"frame": 3})``). They are no
dependency: arviz-plots 0.8, the last for Python 3.11, asks for ``matplotlib.style.core``, which matplotlib 3.11 does not have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.selection import evenly, frame_index, mean_points, segments
from poseppl.diagnostics.simulation_based import Calibration
from poseppl.report.charts import (
    BINS,
    Pairs,
    autocorrelation_traces,
    error_traces,
    inefficiency_heat,
    state_traces,
    trace_panels,
)
from poseppl.report.picture import (
    GRID,
    MUTED,
    OBSERVED,
    POSTERIOR,
    SAMPLE,
    TEXT,
    TRUTH,
    draw,
    draw_heat,
    draw_legend,
    new_picture,
    tidy,
)
from poseppl.report.pose_data import pose_data
from poseppl.runs.contents import frame_numbers, names_of, variable
from poseppl.runs.results import is_weighted, provenance

NUM_OVERLAYS = 5
_COLUMNS, _MOST = 4, 24
_WIDTH = 2.6
"""Standard errors of a bar of ranks: 99 %."""


def plot_track(tree: xr.DataTree) -> Figure:
    """Draw a run on one page: overlays of a few frames, a pose in space, the error over frames, the inefficiency factors.

    A result without a body shows its coordinates over the frames instead.
    """
    whole = diagnosed(tree)
    poses = pose_data(whole, evenly(whole["posterior"].sizes["frame"], NUM_OVERLAYS))
    picture = new_picture(14.0, 8.6)
    picture.suptitle(_title(whole), x=0.01, ha="left", fontsize=13, color=TEXT, fontweight="bold", parse_math=False)
    picture.set_layout_engine("constrained", h_pad=0.08, w_pad=0.06)
    rows = picture.add_gridspec(2, 1)
    upper, lower = picture.add_subfigure(rows[0]), picture.add_subfigure(rows[1])
    if mean_points(whole) is not None and poses is not None:
        for number in range(len(poses["frames"])):
            axes = upper.add_subplot(1, NUM_OVERLAYS, number + 1)
            draw_overlay(axes, poses, number)
        handles = axes.get_legend_handles_labels()[0]
        upper.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False, labelcolor=MUTED)
    else:
        _states(upper, whole, range(min(3, len(names_of(whole, "dof")))), columns=3)
    below = lower.add_gridspec(1, 3, width_ratios=(1.0, 1.35, 1.45))
    if poses is not None and poses["space"] is not None:
        draw_pose3d(lower.add_subplot(below[0], projection="3d"), poses, len(poses["frames"]) // 2)
        _error(lower.add_subplot(below[1]), whole)
    else:
        _state(lower.add_subplot(below[0:2]), whole, 0)
    _inefficiency(lower.add_subplot(below[2]), whole)
    return picture


def plot_overlay(tree: xr.DataTree, frame: int | None = None, camera: int = 0) -> Figure:
    """Draw a frame, the middle one if None, in the image of a camera; see :func:`draw_overlay`."""
    picture = new_picture(4.2, 5.0)
    axes = picture.add_subplot()
    draw_overlay(axes, pose_data(tree, np.array([frame_index(tree, frame)])), camera=camera)
    draw_legend(axes, loc="upper right")
    return picture


def plot_pose3d(tree: xr.DataTree, frame: int | None = None) -> Figure:
    """Draw a frame, the middle one if None, in space; see :func:`draw_pose3d`."""
    picture = new_picture(5.5, 5.5)
    draw_pose3d(picture.add_subplot(projection="3d"), pose_data(tree, np.array([frame_index(tree, frame)])))
    return picture


def plot_error(tree: xr.DataTree) -> Figure:
    """Draw the mean joint error; see :func:`poseppl.report.charts.error_traces`."""
    picture = new_picture(8.0, 3.4)
    _error(picture.add_subplot(), diagnosed(tree))
    return picture


def plot_inefficiency(tree: xr.DataTree) -> Figure:
    """Draw inefficiency factors of every frame and coordinate; for weighted particles their effective number over frames."""
    picture = new_picture(8.0, 2.2 + 0.16 * len(names_of(tree, "dof")))
    _inefficiency(picture.add_subplot(), diagnosed(tree))
    return picture


def plot_autocorrelation(tree: xr.DataTree, pairs: Pairs | None = None) -> Figure:
    """Draw autocorrelation functions of pairs (frame number, coordinate), by default of the six that mix worst.

    Raises:
        ValueError: The draws are no Markov chains.
    """
    traces = autocorrelation_traces(diagnosed(tree), pairs)
    if not traces:
        raise ValueError("weighted particles have no autocorrelation")
    picture = new_picture(8.0, 3.2)
    axes = picture.add_subplot()
    draw(axes, traces)
    tidy(axes, "Autocorrelation", "lag (draws)")
    draw_legend(axes, loc="center left", bbox_to_anchor=(1.01, 0.5))
    return picture


def plot_trace(tree: xr.DataTree, pairs: Pairs | None = None) -> Figure:
    """Draw the traces of chains, with the truth, at pairs (frame number, coordinate), by default the six that mix worst."""
    panels = trace_panels(diagnosed(tree), pairs)
    rows = (len(panels) + 1) // 2
    picture = new_picture(10.0, 0.4 + 1.6 * rows)
    for number, panel in enumerate(panels):
        axes = picture.add_subplot(rows, min(2, len(panels)), number + 1)
        draw(axes, panel.traces)
        tidy(axes, panel.title)
        axes.locator_params(axis="y", nbins=4)
    return picture


def plot_state(tree: xr.DataTree, dofs: Sequence[str] | None = None) -> Figure:
    """Draw mean, central 90 % interval and truth of coordinates over the frames, by default of the first four."""
    names = names_of(tree, "dof")
    chosen = range(min(4, len(names))) if dofs is None else [names.index(name) for name in dofs]
    picture = new_picture(8.0, 1.9 * len(chosen))
    _states(picture, tree, chosen, columns=1)
    return picture


def plot_ranks(calibration: Calibration) -> Figure:
    """Draw the ranks' histograms of the first 24 coordinates, each bar with an interval of 99 % from the simulations' spread.

    Heaped at both ends the posterior is too narrow, in the middle too wide, at one end off to the other side.
    """
    number = min(len(calibration.names), _MOST)
    columns = min(number, _COLUMNS)
    rows = -(-number // columns)
    picture = new_picture(3.2 * columns, 2.4 * rows)
    picture.set_layout_engine("constrained")
    edges = np.linspace(0, 1, BINS + 1)
    for index in range(number):
        axes = picture.add_subplot(rows, columns, index + 1)
        each = np.array([np.histogram(ranks, edges)[0] for ranks in calibration.ranks[..., index]])
        shares = each / each.sum(1, keepdims=True)
        error = _WIDTH * shares.std(0, ddof=1) / np.sqrt(len(shares))
        axes.bar(edges[:-1], shares.mean(0), 1 / BINS, align="edge", color=POSTERIOR, alpha=0.55, yerr=error, ecolor=MUTED)
        axes.axhline(1 / BINS, color=MUTED, linewidth=1.0)
        tidy(axes, calibration.names[index], "rank of the truth")
    return picture


def draw_overlay(axes: Axes, poses: dict[str, Any] | None, number: int = 0, camera: int = 0) -> None:
    """Draw observed markers, the mean of the predicted ones and sampled skeletons in the image.

    Args:
        axes: The axes.
        poses: Of :func:`poseppl.report.pose_data.pose_data`.
        number: Index among its frames.
        camera: Index of the camera.

    Raises:
        ValueError: The result has no ``points``.
    """
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


def draw_pose3d(axes: Any, poses: dict[str, Any] | None, number: int = 0) -> None:
    """Draw sampled poses in space, their mean, and the truth where there is one, into 3-D axes; see :func:`draw_overlay`.

    Raises:
        ValueError: The result has no ``markers``.
    """
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
    title = f"in space, frame {poses['frames'][number]} (mm)"
    axes.set_title(title, loc="left", fontsize=10.5, color=TEXT, fontweight="bold")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 1))
        axis._axinfo["grid"].update(color=GRID, linewidth=0.7)
    axes.tick_params(labelsize=7, colors=MUTED, pad=-2)
    axes.locator_params(nbins=4)
    draw_legend(axes, loc="upper right")


def _skeletons(axes: Any, poses: dict[str, Any], draws: Any, mean: Any) -> None:
    samples = np.concatenate([segments(sample, poses["edges"]) for sample in draws])
    axes.plot(*samples.T, color=SAMPLE, linewidth=0.7, alpha=0.5, label="posterior draws")
    axes.plot(*segments(mean, poses["edges"]).T, color=POSTERIOR, linewidth=2.1, label="posterior mean")


def _states(figure: FigureBase, tree: xr.DataTree, dofs: Sequence[int], columns: int) -> None:
    columns = min(columns, len(dofs))
    for number, dof in enumerate(dofs):
        _state(figure.add_subplot(-(-len(dofs) // columns), columns, number + 1), tree, dof)


def _state(axes: Axes, tree: xr.DataTree, dof: int) -> None:
    draw(axes, state_traces(tree, dof))
    tidy(axes, names_of(tree, "dof")[dof], "frame")


def _error(axes: Axes, tree: xr.DataTree) -> None:
    data = tree["diagnostics"].dataset
    draw(axes, error_traces(tree))
    tidy(axes, "Joint error" if "joint_error" in data else "Uncertainty of the joints", "frame", "mm")
    axes.set_ylim(0, axes.get_ylim()[1] * 1.3)
    draw_legend(axes, loc="upper left")
    if "joint_error" in data:
        told = [
            f"mean {float(data['joint_error'].mean()):.0f} mm, relative {float(data['joint_error_relative'].mean()):.0f} mm"
        ]
        shares: Any = zip(*(data[name].values for name in ("level", "coverage", "coverage_se") if name in data), strict=True)
        told += [
            f"{100 * level:.0f} % intervals cover {100 * share:.0f} ± {100 * error:.0f} %"
            for level, share, error in (shares if "coverage" in data else ())
            if np.isfinite(share)
        ]
        axes.text(0.995, 0.97, "\n".join(told), ha="right", va="top", transform=axes.transAxes, fontsize=8, color=MUTED)


def _inefficiency(axes: Axes, tree: xr.DataTree) -> None:
    effective, found = variable(tree, "diagnostics", "ess"), inefficiency_heat(tree)
    if found is not None:
        tidy(axes, "Inefficiency factor τ", "frame")
        draw_heat(axes, *found)
    elif is_weighted(tree) and effective is not None:
        axes.semilogy(frame_numbers(tree), effective[:, 0], color=POSTERIOR)
        axes.set_ylim(0.8, 1.3 * int(tree.attrs["num_particles"]))
        axes.minorticks_off()
        tidy(axes, f"Effective number of {tree.attrs['num_particles']} particles", "frame")
    else:
        tidy(axes, "Inefficiency factor τ", "frame")
        axes.text(0.5, 0.5, "too few draws a chain", ha="center", va="center", transform=axes.transAxes, color=MUTED)


def _title(tree: xr.DataTree) -> str:
    known = provenance(tree)
    parts = [str(known[name]) for name in ("model", "filter", "smoother", "input") if name in known]
    return " · ".join([*parts, f"{tree['posterior'].sizes['frame']} frames"])
