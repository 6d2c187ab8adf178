"""The figures of the reproduction, drawn from its tables alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import NullFormatter

from poseppl.report.picture import Picture, new_picture
from poseppl_papers.choo_fleet.tuning import choose
from poseppl_papers.experiment import Tables
from poseppl_papers.images.tables import COLOURS
from poseppl_papers.tables import Table

_OF_METHOD = {"particle": "#e4572e", "hmc": "#1f6f8b", "particle filter": "#e4572e", "HMC filter": "#1f6f8b"}
_OTHER = "#c58b1b"
LABELS = {"particle": "particle filter", "hmc": "HMC filter", "arm": "arm, 4-D", "lower_body": "lower body, 10-D"}
LABELS |= {"full_body": "full body, 28-D"}


def draw_variances(tables: Tables) -> Picture:
    """Fig. 3: variance against time above, against evaluations below; a line for each frame, and their mean."""
    table = tables["variances"]
    trackers = table.values("tracker")
    picture = new_picture(4.2 * len(trackers), 7.0)
    axes = picture.subplots(2, len(trackers), squeeze=False)
    for column, tracker in enumerate(trackers):
        for row, by in enumerate(("seconds", "evaluations")):
            axis = axes[row, column]
            for method in ("particle", "hmc"):
                _curves(axis, table, tracker, method, by)
            axis.set(xscale="log", yscale="log", xlabel="seconds" if by == "seconds" else "likelihoods and gradients")
            axis.xaxis.set_minor_formatter(NullFormatter())
        axes[0, column].set_title(LABELS[tracker])
    for axis in axes[:, 0]:
        axis.set_ylabel("variance / posterior variance")
    axes[0, 0].legend()
    return picture


def _curves(axis: Any, table: Table, tracker: str, method: str, by: str) -> None:
    frames = list(dict.fromkeys(row[1:3] for row in table.select(tracker=tracker, method=method)))
    curves = []
    for recording, frame in frames:
        where: dict[str, Any] = {"tracker": tracker, "method": method, "recording": recording, "frame": frame}
        variance, spread = (table.column(name, **where) for name in ("variance", "log_standard_error"))
        curves.append(np.log(variance))
        bars = np.stack([variance * (1 - np.exp(-spread)), variance * (np.exp(spread) - 1)])
        axis.errorbar(table.column(by, **where), variance, bars, color=_OF_METHOD[method], alpha=0.3, linewidth=0.8)
    cost = table.column(by, **where)
    axis.plot(cost, np.exp(np.mean(curves, axis=0)), "o-", color=_OF_METHOD[method], label=LABELS[method])


def draw_coordinates(tables: Tables) -> Picture:
    """Fig. 2: variances of single variables against time; three variables with standard errors, the others faint."""
    table = tables["coordinates"]
    trackers = table.values("tracker")
    picture = new_picture(4.2 * len(trackers), 4.4)
    for axis, tracker in zip(picture.subplots(1, len(trackers), squeeze=False)[0], trackers, strict=True):
        names = table.values("coordinate", tracker=tracker)
        shown = {names[number * (len(names) - 1) // 2]: marker for number, marker in enumerate("os^")}
        for method, name in itertools.product(("particle", "hmc"), names):
            where: dict[str, Any] = {"tracker": tracker, "method": method}
            variance, error = (table.column(each, **where, coordinate=name) for each in ("variance", "standard_error"))
            here = {each: table.values(each, tracker=tracker)[0] for each in ("recording", "frame")}
            seconds = tables["variances"].column("seconds", **where, **here)
            if name in shown:
                label = f"{LABELS[method]}, {name}"
                axis.errorbar(seconds, variance, error, color=_OF_METHOD[method], marker=shown[name], label=label)
            else:
                axis.plot(seconds, variance, color=_OF_METHOD[method], alpha=0.2, linewidth=0.8)
        axis.set(xscale="log", yscale="log", xlabel="seconds", title=LABELS[tracker])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.legend(fontsize=6)
    picture.axes[0].set_ylabel("variance / posterior variance")
    return picture


def draw_sequence(tables: Tables) -> Picture:
    """Figs. 4 and 5: log-likelihood of the mean state and log prior of the true state over frames, with standard errors."""
    table = tables["sequence"]
    trackers = table.values("tracker")
    picture = new_picture(5.0 * len(trackers), 8.5)
    axes = picture.subplots(3, len(trackers), squeeze=False)
    names = {
        "log_likelihood": "log-likelihood of the mean state",
        "log_prior": "log prior of the true state",
        "error": "markers' error, mm",
    }
    for column, tracker in enumerate(trackers):
        for row, (name, label) in enumerate(names.items()):
            axis = axes[row, column]
            for method in table.values("method", tracker=tracker):
                values = (
                    table.column(each, tracker=tracker, method=method) for each in ("frame", name, f"{name}_standard_error")
                )
                frame, mean, spread = values
                axis.errorbar(frame, mean, spread, color=_OF_METHOD.get(method, _OTHER), label=method, linewidth=1.2)
            axis.set(ylabel=label if column == 0 else "", yscale="symlog" if name == "log_prior" else "linear")
        axes[0, column].set_title(LABELS[tracker])
        axes[0, column].legend(fontsize=8)
        axes[-1, column].set_xlabel("frame")
    return picture


def draw_poses(poses: Mapping[str, Any]) -> Picture:
    """Fig. 6: mean poses of six runs of each method at frame 10: along the path, across it, and in the picture.

    The truth, and in the picture the run's 2-D observations, are black.

    Args:
        poses: ``edges`` (edge, 2), and for each method its "truth", "mean", "observed" and "image": places (run, marker, 3) in
            mm, and points (run, marker, 2) of the observations and of the mean's image.
    """
    methods = [name for name in poses if name != "edges"]
    count = max(len(poses[name]["mean"]) for name in methods)
    picture = new_picture(2.0 * count, 6.5 * len(methods))
    axes = picture.subplots(3 * len(methods), count, squeeze=False)
    for number, method in enumerate(methods):
        truth, mean, observed, image = (np.asarray(poses[method][name]) for name in ("truth", "mean", "observed", "image"))
        views = [(truth[..., plane], mean[..., plane]) for plane in ([0, 2], [1, 2])] + [(observed, image)]
        for view, pairs in enumerate(views):
            for axis, *pair in zip(axes[3 * number + view], *pairs, strict=False):
                for points, colour, width in zip(pair, ("#1b1b1e", "#b3261e"), (1.6, 1.0), strict=True):
                    for edge in poses["edges"]:
                        axis.plot(*points[edge].T, color=colour, linewidth=width)
        axes[3 * number, 0].set_title(f"{method}: along the path, across it, in the picture", loc="left", fontsize=9)
    for axis in axes.ravel():
        axis.set_aspect("equal")
        axis.set_axis_off()
    return picture


def draw_tuning(tables: Tables) -> Picture:
    """Section 7.5: rejection against epsilon, autocorrelation and cost against L, R-hat against b; our choice is marked."""
    parts = tables["tuning"], tables["autocorrelation"], tables["burn_in"]
    mixing, correlation, burn_in = parts
    chosen = choose(parts)
    picture = new_picture(11.0, 8.0)
    (rejected, costly), (correlated, settled) = picture.subplots(2, 2)
    for number, leapfrog in enumerate(mixing.values("leapfrog")):
        style: dict[str, Any] = {"color": COLOURS[number % len(COLOURS)], "label": f"L = {leapfrog}"}
        step_size = mixing.column("step_size", leapfrog=leapfrog)
        rejected.plot(step_size, mixing.column("rejection", leapfrog=leapfrog), "o-", **style)
        costly.plot(step_size, mixing.column("gradients_per_draw", leapfrog=leapfrog), "o-", **style)
        if chosen:
            where = {"leapfrog": leapfrog, "step_size": chosen["step_size"]}
            correlated.plot(correlation.column("lag", **where), correlation.column("autocorrelation", **where), **style)
            settled.plot(burn_in.column("burn_in", **where), burn_in.column("rhat", **where), **style)
    rejected.axhline(0.15, color="#69727d", linestyle=":")
    rejected.set(xlabel="step size", ylabel="rejection rate")
    costly.set(xlabel="step size", ylabel="gradients an independent draw", yscale="log")
    if chosen:
        for axis in (rejected, costly):
            axis.axvline(chosen["step_size"], color="#69727d", linewidth=0.8)
        rejected.set_title(f"chosen: L = {chosen['leapfrog']}, step size {chosen['step_size']:g}", fontsize=10)
        if chosen["is_settled"]:
            settled.axvline(chosen["burn_in"], color="#69727d", linewidth=0.8)
        correlated.set_title(f"at step size {chosen['step_size']:g}", fontsize=10)
        title = f"chosen: burn-in {chosen['burn_in']}" if chosen["is_settled"] else "no burn-in brings R-hat below 1.2"
        settled.set_title(title, fontsize=10)
    correlated.set(xlabel="lag", ylabel="autocorrelation")
    settled.set(xlabel="burn-in", ylabel="largest R-hat of the next 16 updates", yscale="log")
    rejected.legend(fontsize=8)
    return picture


def draw_contest(tables: Tables) -> Picture:
    """The contest: error against time and evaluations at one frame; error, coverage and speed over time."""
    one, many = tables["contest"], tables["contest_sequences"]
    picture = new_picture(13.0, 4.6)
    cost, error, cover = picture.subplots(1, 3)
    methods = dict.fromkeys([*one.values("method"), *many.values("method")])
    for number, method in enumerate(methods):
        style: dict[str, Any] = {
            "color": COLOURS[number % len(COLOURS)],
            "marker": "os^vD"[number // len(COLOURS)],
            "label": method,
        }
        cost.plot(one.column("seconds", method=method), one.column("variance", method=method), linestyle="", **style)
        rates = many.column("frames_per_second", method=method)
        error.plot(rates, many.column("error", method=method), linestyle="", **style)
        cover.plot(rates, 100 * many.column("markers_in_90", method=method), linestyle="", **style)
    cost.set(xscale="log", yscale="log", xlabel="seconds", ylabel="squared error / posterior variance", title="one frame")
    error.set(xscale="log", xlabel="frames a second", ylabel="markers' error, mm", title="sequences")
    cover.axhspan(87, 93, color="#cfe6ee")
    cover.set(xscale="log", xlabel="frames a second", ylabel="coverage of 90 % intervals, %", title="sequences")
    picture.legend(*error.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    return picture
