"""Poses drawn into axes: the skeleton over its observations, and in space with its uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from poseppl.diagnostics.selection import segments
from poseppl.report.picture import GRID, MUTED, OBSERVED, POSTERIOR, SAMPLE, TEXT, TRUTH, draw_legend

Poses = dict[str, Any] | None


def draw_overlay(axes: Axes, poses: Poses, number: int = 0, camera: int = 0) -> None:
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


def draw_pose3d(axes: Any, poses: Poses, number: int = 0) -> None:
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
    low, high = (centre + sign * space["reach"] for centre, sign in zip([space["centre"][number]] * 2, (-1, 1), strict=True))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
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
