"""Pictures of the sampling: inefficiency factors, autocorrelations and traces of the chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from poseppl.diagnostics.selection import diagnosed, frame_numbers, variable, worst_pairs
from poseppl.report.picture import GRID, MUTED, OBSERVED, POSTERIOR, SAMPLE, new_picture, tidy
from poseppl.report.pose import frame_index
from poseppl.runs.results import is_weighted

Pairs = Sequence[tuple[int, str]]


def plot_inefficiency(tree: xr.DataTree) -> Figure:
    """Draw inefficiency factors of every frame and coordinate; for weighted particles their effective number over frames.

    Args:
        tree: The result.

    Returns:
        The figure.
    """
    picture = new_picture(8.0, 2.2 + 0.16 * tree["posterior"].sizes["dof"])
    draw_inefficiency(picture.add_subplot(), diagnosed(tree))
    return picture


def draw_inefficiency(axes: Axes, tree: xr.DataTree) -> None:
    """Draw inefficiency factors into given axes; see :func:`plot_inefficiency`.

    Args:
        axes: The axes.
        tree: A diagnosed result.
    """
    tau, frames = variable(tree, "diagnostics", "tau"), frame_numbers(tree)
    if is_weighted(tree):
        effective = variable(tree, "diagnostics", "ess")
        axes.plot(frames, np.zeros(0) if effective is None else effective[:, 0], color=POSTERIOR)
        axes.set_yscale("log")
        axes.set_ylim(0.8, 1.3 * int(tree.attrs["num_particles"]))
        axes.minorticks_off()
        tidy(axes, f"Effective number of {tree.attrs['num_particles']} particles", "frame")
        return
    tidy(axes, "Inefficiency factor τ", "frame")
    if tau is None or np.isnan(tau).all():
        axes.text(0.5, 0.5, "too few draws a chain", ha="center", va="center", transform=axes.transAxes, color=MUTED)
        return
    high = max(float(np.nanmax(tau)), 10.0)
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    extent = (frames[0] - 0.5, frames[-1] + 0.5, len(names) - 0.5, -0.5)
    image = axes.imshow(
        tau.T, aspect="auto", cmap="YlGnBu", norm=LogNorm(1, high, clip=True), extent=extent, interpolation="nearest"
    )
    axes.grid(False)
    axes.set_yticks(range(len(names)), names, fontsize=6.5 if len(names) > 12 else 8, parse_math=False)
    figure = axes.get_figure()
    if figure is not None:
        bar = figure.colorbar(image, ax=axes, pad=0.015, fraction=0.04)
        bar.ax.tick_params(labelsize=7, colors=MUTED, length=0)
        bar.outline.set_visible(False)


def plot_autocorrelation(tree: xr.DataTree, pairs: Pairs | None = None) -> Figure:
    """Draw autocorrelation functions over the band that the middle 90 % of frames and coordinates fill.

    Args:
        tree: The result.
        pairs: (frame number, name of a coordinate) to draw; the six that mix worst if None.

    Returns:
        The figure.

    Raises:
        ValueError: The draws are no Markov chains.
    """
    whole = diagnosed(tree)
    rho = variable(whole, "diagnostics", "autocorrelation")
    if rho is None:
        raise ValueError("weighted particles have no autocorrelation")
    picture = new_picture(8.0, 3.2)
    axes = picture.add_subplot()
    tidy(axes, "Autocorrelation", "lag (draws)", "")
    lags = np.arange(len(rho))
    series = rho.reshape(len(rho), -1)
    series = series[:, np.isfinite(series).all(axis=0)]
    if series.size:
        low, middle, high = np.quantile(series, [0.05, 0.5, 0.95], axis=1)
        axes.fill_between(lags, low, high, color=GRID, label="middle 90 % of all")
        axes.plot(lags, middle, color=MUTED, linewidth=1.5, label="median of all")
    chosen = _indices(whole, pairs)
    for (frame, dof), color in zip(chosen, colormaps["viridis"](np.linspace(0.05, 0.85, max(len(chosen), 1))), strict=False):
        axes.plot(lags, rho[:, frame, dof], color=color, linewidth=1.3, label=_label(whole, frame, dof))
    axes.axhline(0, color=MUTED, linewidth=0.7)
    _legend(axes)
    return picture


def plot_trace(tree: xr.DataTree, pairs: Pairs | None = None) -> Figure:
    """Draw the traces of all chains, with the truth where there is one.

    Args:
        tree: The result.
        pairs: (frame number, name of a coordinate) to draw; the six that mix worst if None.

    Returns:
        The figure.
    """
    whole = diagnosed(tree)
    state, truth = whole["posterior"].dataset["state"].values, variable(whole, "truth", "state")
    chosen = _indices(whole, pairs) or [(frame_index(whole, None), dof) for dof in range(min(6, state.shape[3]))]
    rows = (len(chosen) + 1) // 2
    picture = new_picture(10.0, 0.4 + 1.6 * rows)
    colors = colormaps["viridis"](np.linspace(0.0, 0.9, state.shape[0]))
    for number, (frame, dof) in enumerate(chosen):
        axes = picture.add_subplot(rows, min(2, len(chosen)), number + 1)
        for chain, color in zip(state[:, :, frame, dof], colors, strict=True):
            axes.plot(chain, color=color, linewidth=0.8, alpha=0.8)
        if truth is not None:
            axes.axhline(truth[frame, dof], color=OBSERVED, linewidth=1.4, linestyle=(0, (4, 2)))
        tidy(axes)
        axes.set_title(_label(whole, frame, dof), loc="left", fontsize=9, parse_math=False)
        axes.locator_params(axis="y", nbins=4)
    return picture


def plot_state(tree: xr.DataTree, dofs: Sequence[str] | None = None) -> Figure:
    """Draw the filtered mean and the central 90 % interval of coordinates over the frames, with the truth.

    Args:
        tree: The result.
        dofs: Names of coordinates; the first four if None.

    Returns:
        The figure.
    """
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    chosen = list(dofs) if dofs is not None else names[:4]
    picture = new_picture(8.0, 1.9 * len(chosen))
    for number, name in enumerate(chosen):
        axes = picture.add_subplot(len(chosen), 1, number + 1)
        draw_state(axes, tree, names.index(name))
    return picture


def draw_state(axes: Axes, tree: xr.DataTree, dof: int) -> None:
    """Draw one coordinate over the frames into given axes; see :func:`plot_state`.

    Args:
        axes: The axes.
        tree: The result.
        dof: Index of the coordinate.
    """
    frames, summary = frame_numbers(tree), tree["summary"].dataset
    if "state_quantile" in summary:
        band = summary["state_quantile"].values[:, :, dof]
        axes.fill_between(frames, band[:, 0], band[:, -1], color=SAMPLE, alpha=0.35, linewidth=0)
    axes.plot(frames, summary["state_mean"].values[:, dof], color=POSTERIOR, linewidth=1.6)
    truth = variable(tree, "truth", "state")
    if truth is not None:
        axes.plot(frames, truth[:, dof], color="black", linewidth=1.0)
    tidy(axes, "", "frame")
    axes.set_title(str(tree["posterior"].dataset["dof"].values[dof]), loc="left", fontsize=10, parse_math=False)


def _indices(tree: xr.DataTree, pairs: Pairs | None) -> list[tuple[int, int]]:
    if pairs is None:
        return worst_pairs(tree, 6)
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    return [(frame_index(tree, frame), names.index(name)) for frame, name in pairs]


def _label(tree: xr.DataTree, frame: int, dof: int) -> str:
    tau = variable(tree, "diagnostics", "tau")
    factor = f", τ = {tau[frame, dof]:.1f}" if tau is not None and np.isfinite(tau[frame, dof]) else ""
    return f"{tree['posterior'].dataset['dof'].values[dof]}, frame {frame_numbers(tree)[frame]}{factor}"


def _legend(axes: Axes) -> None:
    legend = axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.01, 0.5))
    for text in legend.get_texts():
        text.set_parse_math(False)
