"""Pictures of a body's poses and errors, one call each."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase

from poseppl.diagnostics.diagnosis import diagnosed
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.selection import evenly, frame_index
from poseppl.motion.measures import segments
from poseppl.motion.report.pose_views import pose_data
from poseppl.motion.report.sections import error_traces
from poseppl.report.chart import Panel
from poseppl.report.charts import inefficiency_panel
from poseppl.report.figures import TITLE, draw_coordinates, draw_panel, legend
from poseppl.report.picture import GRID, MUTED, OBSERVED, POSTERIOR, SAMPLE, TEXT, TRUTH, new_picture

NUM_OVERLAYS = 5


def draw_track(upper: FigureBase, lower: FigureBase, tree: xr.DataTree) -> None:
    """Draw overlays of a few frames above; below a pose in space, the error over frames, and the inefficiency factors."""
    poses = pose_data(tree, evenly(tree["posterior"].sizes["frame"], NUM_OVERLAYS)) or {"space": None, "image": None}
    if poses["image"] is None:
        draw_coordinates(upper, tree)
    else:
        for number in range(len(poses["frames"])):
            axes = upper.add_subplot(1, NUM_OVERLAYS, number + 1)
            _overlay(axes, poses, number)
        handles = axes.get_legend_handles_labels()[0]
        upper.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False, labelcolor=MUTED)
    if poses["space"] is None:
        draw_panel(lower.add_subplot(), inefficiency_panel(tree))
        return
    sampled = is_sampled(tree)
    below = lower.add_gridspec(1, 3 if sampled else 2, width_ratios=(1.0, 1.35, 1.45) if sampled else (1.0, 2.8))
    _pose3d(lower.add_subplot(below[0], projection="3d"), poses, len(poses["frames"]) // 2)
    _error(lower.add_subplot(below[1]), tree)
    if sampled:
        draw_panel(lower.add_subplot(below[2]), inefficiency_panel(tree))


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
    legend(axes, loc="upper right")
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
    """Draw the mean joint error; see :func:`poseppl.motion.report.sections.error_traces`."""
    picture = new_picture(8.0, 3.4)
    _error(picture.add_subplot(), diagnosed(tree))
    return picture


def _overlay(axes: Axes, poses: dict[str, Any] | None, number: int = 0, camera: int = 0) -> None:
    """Draw one of some frames (of :func:`poseppl.motion.report.pose_views.pose_data`) in an image."""
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
    axes.set_title(f"in space, frame {poses['frames'][number]} (mm)", **TITLE)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 1))
        axis._axinfo["grid"].update(color=GRID, linewidth=0.7)
    axes.tick_params(labelsize=7, colors=MUTED, pad=-2)
    axes.locator_params(nbins=4)
    legend(axes, loc="upper right")


def _skeletons(axes: Any, poses: dict[str, Any], draws: Any, mean: Any) -> None:
    samples = np.concatenate([segments(sample, poses["edges"]) for sample in draws])
    axes.plot(*samples.T, color=SAMPLE, linewidth=0.7, alpha=0.5, label="posterior draws")
    axes.plot(*segments(mean, poses["edges"]).T, color=POSTERIOR, linewidth=2.1, label="posterior mean")


def _error(axes: Axes, tree: xr.DataTree) -> None:
    data = tree["diagnostics"].dataset
    title, lines = "Uncertainty of the joints", []
    if "joint_error" in data:
        absolute, relative = (float(data[name].mean()) for name in ("joint_error", "joint_error_relative"))
        title, lines = "Joint error", [f"mean {absolute:.0f} mm, relative {relative:.0f} mm"]
        lines += [
            f"{100 * level:.0f} % intervals cover {100 * share:.0f} ± {100 * error:.0f} %"
            for level, share, error in zip(*(data.get(name, []) for name in ("level", "coverage", "coverage_se")), strict=False)
            if np.isfinite(share)
        ]
    draw_panel(axes, Panel(error_traces(tree), title, {"title_text": "mm"}))
    axes.set_ylim(0, axes.get_ylim()[1] * 1.3)
    legend(axes, loc="upper left")
    axes.text(0.995, 0.97, "\n".join(lines), ha="right", va="top", transform=axes.transAxes, fontsize=8, color=MUTED)
