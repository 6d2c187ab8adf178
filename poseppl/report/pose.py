"""Pictures of one frame: the skeleton over its observations, and in space with its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from poseppl.diagnostics.selection import (
    Array,
    edges,
    frame_numbers,
    image_grows_down,
    mean_points,
    segments,
    some_draws,
    variable,
)
from poseppl.report.picture import GRID, MUTED, OBSERVED, POSTERIOR, SAMPLE, TEXT, TRUTH, new_picture

MAX_SAMPLES = 20


def plot_overlay(tree: xr.DataTree, frame: int | None = None, camera: int = 0) -> Figure:
    """Draw observed markers, the mean of the predicted ones and sampled skeletons in the image.

    Args:
        tree: The result; it needs the extra ``points``.
        frame: Frame number; the middle one if None.
        camera: Index of the camera.

    Returns:
        The figure.

    Raises:
        ValueError: The result has no ``points``, or no such frame.
    """
    picture = new_picture(4.2, 5.0)
    axes = picture.add_subplot()
    draw_overlay(axes, tree, frame_index(tree, frame), camera)
    axes.legend(handles=overlay_legend(), loc="upper right", fontsize=8, frameon=False)
    return picture


def plot_pose3d(tree: xr.DataTree, frame: int | None = None) -> Figure:
    """Draw the skeleton of one frame in space: sampled poses, their mean, and the truth where there is one.

    Args:
        tree: The result; it needs the extra ``markers``.
        frame: Frame number; the middle one if None.

    Returns:
        The figure.

    Raises:
        ValueError: The result has no ``markers``, or no such frame.
    """
    picture = new_picture(5.5, 5.5)
    draw_pose3d(picture.add_subplot(projection="3d"), tree, frame_index(tree, frame))
    return picture


def frame_index(tree: xr.DataTree, frame: int | None) -> int:
    """Index of a frame number; the middle frame if None.

    Args:
        tree: The result.
        frame: Frame number.

    Returns:
        The index.

    Raises:
        ValueError: There is no such frame.
    """
    numbers = frame_numbers(tree)
    if frame is None:
        return len(numbers) // 2
    found = np.flatnonzero(numbers == frame)
    if not len(found):
        raise ValueError(f"the result has no frame {frame}; expected {numbers[0]} to {numbers[-1]}")
    return int(found[0])


def overlay_legend() -> list[Line2D]:
    """Handles that explain an overlay."""
    return [
        Line2D([], [], marker="o", markerfacecolor="none", color=OBSERVED, linestyle="", label="observed"),
        Line2D([], [], color=POSTERIOR, linewidth=2, label="posterior mean"),
        Line2D([], [], color=SAMPLE, linewidth=1, label="posterior draws"),
    ]


def draw_overlay(axes: Axes, tree: xr.DataTree, index: int, camera: int = 0) -> None:
    """Draw an overlay into given axes; see :func:`plot_overlay`.

    Args:
        axes: The axes.
        tree: The result.
        index: Index of the frame.
        camera: Index of the camera.

    Raises:
        ValueError: The result has no ``points``.
    """
    mean, draws = mean_points(tree), some_draws(tree, "points", MAX_SAMPLES)
    if mean is None or draws is None:
        raise ValueError("the result has no points: run with a model whose observation program declares them")
    pairs = edges(tree)
    for sample in draws[:, index, camera]:
        _line(axes, segments(sample, pairs), SAMPLE, 0.7, 0.45)
    centre = mean[index, camera]
    _line(axes, segments(centre, pairs), POSTERIOR, 2.0, 1.0)
    axes.plot(*centre.T, ".", color=POSTERIOR, markersize=4)
    seen = variable(tree, "observed_data", "points")
    shown = [centre, *draws[:, index, camera]]
    if seen is not None:
        axes.plot(
            *seen[index, camera].T, "o", markerfacecolor="none", markeredgecolor=OBSERVED, markersize=6, markeredgewidth=1.4
        )
        shown.append(seen[index, camera])
    _square(axes, np.concatenate(shown))
    if image_grows_down(tree, camera):
        axes.invert_yaxis()
    axes.set_title(f"frame {frame_numbers(tree)[index]}", loc="left", fontsize=9.5, color=TEXT)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(GRID)


def draw_pose3d(axes: Any, tree: xr.DataTree, index: int) -> None:
    """Draw a pose into given 3-D axes; see :func:`plot_pose3d`.

    Args:
        axes: The axes.
        tree: The result.
        index: Index of the frame.

    Raises:
        ValueError: The result has no ``markers``.
    """
    mean, draws = variable(tree, "summary", "markers_mean"), some_draws(tree, "markers", MAX_SAMPLES)
    if mean is None or draws is None:
        raise ValueError("the result has no markers: run with a model whose observation program declares them")
    pairs = edges(tree)
    for sample in draws[:, index]:
        axes.plot(*segments(sample, pairs).T, color=SAMPLE, linewidth=0.7, alpha=0.5)
    axes.plot(*segments(mean[index], pairs).T, color=POSTERIOR, linewidth=2.2, label="posterior mean")
    axes.scatter(*mean[index].T, color=POSTERIOR, s=9, depthshade=False)
    truth = variable(tree, "truth", "markers")
    if truth is not None:
        axes.plot(*segments(truth[index], pairs).T, color=TRUTH, linewidth=1.4, label="truth")
    points = np.concatenate([mean[index], draws[:, index].reshape(-1, 3)])
    low, high = np.quantile(points, 0.01, axis=0), np.quantile(points, 0.99, axis=0)
    reach = 0.5 * float(np.max(high - low)) + 60.0
    for set_limits, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), (low + high) / 2, strict=True):
        set_limits(centre - reach, centre + reach)
    axes.set_box_aspect((1, 1, 1), zoom=1.15)
    axes.view_init(elev=14, azim=-58)
    axes.set_title(
        f"in space, frame {frame_numbers(tree)[index]} (mm)", loc="left", fontsize=10.5, color=TEXT, fontweight="bold"
    )
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1, 1, 1, 1))
        axis._axinfo["grid"].update(color=GRID, linewidth=0.7)
    axes.tick_params(labelsize=7, colors=MUTED, pad=-2)
    axes.locator_params(nbins=4)
    axes.legend(loc="upper right", fontsize=8, frameon=False)


def _line(axes: Axes, path: Array, color: str, width: float, alpha: float) -> None:
    axes.plot(path[:, 0], path[:, 1], color=color, linewidth=width, alpha=alpha, solid_capstyle="round")


def _square(axes: Axes, points: Array) -> None:
    """Frame the bulk of the points in a window of the height of the body."""
    low, high = np.nanquantile(points, 0.01, axis=0), np.nanquantile(points, 0.99, axis=0)
    reach = 0.55 * float(np.max(high - low)) or 1.0
    centre = (low + high) / 2
    axes.set_xlim(centre[0] - 0.8 * reach, centre[0] + 0.8 * reach)
    axes.set_ylim(centre[1] - 1.06 * reach, centre[1] + 1.06 * reach)
    axes.set_aspect("equal")
