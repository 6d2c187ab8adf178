"""The charts of a result: error, coverage, mixing, evidence, predictions, autocorrelation, traces, coordinates; and titles.

>>> short_names("/data/pose/cam1, /data/pose/cam2")
'cam1, cam2'
>>> short_names("run/cam1/points.json, run/cam2/points.json")
'cam1/points.json, cam2/points.json'
"""

from __future__ import annotations

import textwrap
from pathlib import PurePath
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.colors import to_hex
from plotly import graph_objects as go

from poseppl.diagnostics.batches import mean_interval
from poseppl.diagnostics.modes import Modes
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.selection import Array, evenly, frame_index, has_chains, worst_pairs
from poseppl.report.chart import (
    DOTTED,
    Panel,
    Traces,
    bars,
    chart,
    color_axis,
    coverage_chart,
    fan,
    grid,
    heat,
    line,
    points,
    stack,
)
from poseppl.report.picture import GRID, MODES, MUTED, OBSERVED, POSTERIOR, SAMPLE, TRUTH
from poseppl.runs.contents import flat_draws, frame_numbers, group_of, names_of, variable
from poseppl.runs.results import is_weighted, provenance

MAX_CHAINS = 40
BINS = 10


def charts(tree: xr.DataTree) -> dict[str, Any]:
    """Make the charts that a diagnosed result has data for, by name; of ``coordinates`` one each, by its name."""
    made: dict[str, Any] = {
        "coverage": _coverage(tree),
        "inefficiency": _inefficiency(tree),
        "progress": _progress(tree),
        "predictions": prediction_chart(tree),
    }
    if has_chains(tree):
        made["autocorrelation"] = chart(autocorrelation_traces(tree), "", xlabel="lag (draws)", yaxis_rangemode="normal")
        panels = trace_panels(tree)
        made["trace"] = grid(panels, columns=min(2, len(panels)), height=60 + 90 * len(panels), showlegend=False)
    made["coordinates"] = {
        name: chart(state_traces(tree, state_dim), "", height=300, yaxis_rangemode="normal")
        for state_dim, name in enumerate(names_of(tree, "state_dim"))
    }
    return {name: each for name, each in made.items() if each is not None}


def state_traces(tree: xr.DataTree, state_dim: int) -> Traces:
    """Filtered mean of a coordinate over the frames, on its central 90 % interval, with the truth."""
    x, summary, truth = frame_numbers(tree), tree["summary"].dataset, variable(tree, "truth", "state")
    mean = summary["state_mean"].values[:, state_dim]
    traces = [line(x, mean, "posterior mean", POSTERIOR)]
    if "state_quantile" in summary:
        low, *_, high = summary["state_quantile"].values[:, :, state_dim].T
        traces = fan(x, (low, mean, high))
    return traces if truth is None else [*traces, line(x, truth[:, state_dim], "truth", TRUTH)]


def inefficiency_panel(tree: xr.DataTree) -> Panel:
    """Inefficiency factors of every frame and coordinate; of weighted particles their effective number over the frames."""
    tau, effective = variable(tree, "diagnostics", "tau"), variable(tree, "diagnostics", "ess")
    x, count = frame_numbers(tree), tree.attrs.get("num_particles")
    if not is_sampled(tree):
        return Panel([], "Inefficiency factor τ", missing="closed form: no Monte Carlo error")
    if is_weighted(tree) and effective is not None and count is not None:
        axis = {"type": "log", "range": np.log10([0.8, 1.3 * int(count)])}
        return Panel([line(x, effective[:, 0], "", POSTERIOR)], f"Effective number of {count} particles", axis)
    if is_weighted(tree) or tau is None or np.isnan(tau).all():
        return Panel([], "Inefficiency factor τ", missing="too few draws a chain")
    return Panel([heat(x, names_of(tree, "state_dim"), tau.T, "τ =", logarithmic=True)], "Inefficiency factor τ")


def autocorrelation_traces(tree: xr.DataTree) -> Traces:
    """Autocorrelation functions where the chains mix worst, on the band that the middle 90 % of all fill."""
    rho = variable(tree, "diagnostics", "autocorrelation")
    if rho is None:
        return []
    lags, series, chosen = np.arange(len(rho)), rho.reshape(len(rho), -1), worst_pairs(tree, 6)
    series = series[:, np.isfinite(series).all(axis=0)]
    traces: Traces = []
    if series.size:
        ends = np.quantile(series, [0.05, 0.5, 0.95], axis=1)
        traces += fan(lags, ends, ("middle 90 % of all", "median of all"), (GRID, MUTED))
    for (frame, state_dim), color in zip(chosen, _viridis(len(chosen)), strict=True):
        traces.append(line(lags, rho[:, frame, state_dim], _label(tree, frame, state_dim), color))
    return traces


def trace_panels(tree: xr.DataTree) -> list[Panel]:
    """Traces of the chains where they mix worst, with the truth where there is one; every k-th draw and chain of many."""
    state, truth = flat_draws(tree).values, variable(tree, "truth", "state")
    chains, draws, panels = evenly(state.shape[0], MAX_CHAINS), np.arange(state.shape[1]), []
    for frame, state_dim in worst_pairs(tree, 6) or [
        (frame_index(tree, None), state_dim) for state_dim in range(min(6, state.shape[3]))
    ]:
        traces = [
            line(draws, state[chain, :, frame, state_dim], f"chain {chain}", color, line_width=0.9)
            for chain, color in zip(chains, _viridis(len(chains)), strict=True)
        ]
        if truth is not None:
            level = np.full(2, truth[frame, state_dim])
            traces.append(line(draws[[0, -1]], level, "truth", OBSERVED, line_width=1.5, line_dash="dash"))
        panels.append(Panel(traces, _label(tree, frame, state_dim)))
    return panels


def _coverage(tree: xr.DataTree) -> go.Figure | None:
    levels, rows = variable(tree, "diagnostics", "level"), []
    data = group_of(tree, "diagnostics")
    names = [str(name) for name in data if str(name).startswith("coverage") and f"{name}_se" in data]
    for name, color in zip(names, (POSTERIOR, OBSERVED), strict=False):
        label = name.removeprefix("coverage").removeprefix("_") or "state"
        share, error = variable(tree, "diagnostics", name), variable(tree, "diagnostics", f"{name}_se")
        if levels is not None and share is not None and error is not None and np.isfinite(share).all():
            rows.append(points(100 * levels, 100 * share, f"{label} (± 2 standard errors)", color, 100 * error))
    return coverage_chart(rows)


def _inefficiency(tree: xr.DataTree) -> go.Figure | None:
    drawn = inefficiency_panel(tree).traces
    if is_weighted(tree) or not drawn:
        return None
    axis = {"autorange": "reversed", "type": "category", "tickfont_size": 10, "automargin": True}
    colors = color_axis(1, max(10.0, np.nanmax(drawn[0].customdata)), "τ", logarithmic=True)
    height = 130 + 17 * max(len(names_of(tree, "state_dim")), 6)
    return chart(drawn, "", height=height, coloraxis=colors, hovermode="closest", yaxis=axis)


def _progress(tree: xr.DataTree) -> go.Figure | None:
    """Evidence, effective size and rejection over the frames, one panel below the other."""
    x, weighted, sampled = frame_numbers(tree), is_weighted(tree), is_sampled(tree)
    ess, rejection = variable(tree, "diagnostics", "ess"), variable(tree, "diagnostics", "rejection_rate")
    step = variable(tree, "sample_stats", "step_size")
    found = {
        "log evidence": variable(tree, "sample_stats", "log_evidence"),
        "effective number" if weighted else "least ESS": np.fmin.reduce(ess, axis=1) if sampled and ess is not None else None,
        "unique ancestors": variable(tree, "sample_stats", "unique_ancestors") if sampled else None,
        "step size": None if step is None or len(np.unique(step[np.isfinite(step)])) < 2 else step,
        "rejection (%)": None if rejection is None or weighted else 100 * rejection,
    }
    panels = [
        Panel([line(x, values, label, POSTERIOR)], label, {"rangemode": "normal" if label == "log evidence" else "tozero"})
        for label, values in found.items()
        if values is not None and np.isfinite(values).any()
    ]
    return stack(panels, height=130, showlegend=False)


def prediction_chart(tree: xr.DataTree) -> go.Figure | None:
    """Histogram of the probability integral transforms of a run's predictive checks, which is flat if they are calibrated.

    Bars high at both ends mean predictions that are too narrow, a hump ones that are too wide, a slope ones that are biased
    (Diebold, Gunther and Tay 1998, doi:10.2307/2527342). A bar's standard error is that of the share of a frame's data in its
    bin, by batches of consecutive frames; none where the result has no predictive checks.
    """
    transform = variable(tree, "predictive", "transform")
    if transform is None or not np.isfinite(transform).any():
        return None
    share, error = transform_shares(np.asarray(transform, np.float64))
    drawn = histogram(100 * share, 200 * error, "share of the data (± 2 standard errors)", "calibrated", 100.0)
    label = "rank among the predicted values"
    return chart(drawn, "data (%)", xlabel=label, height=260, xaxis_range=[0, 1], hovermode="closest")


def histogram(share: Array, error: Array, name: str, ideal: str, whole: float = 1.0) -> list[Any]:
    """Bars of the share of each bin between 0 and 1, with their error, and the line where all are equal."""
    look = {"color": SAMPLE, "line": {"color": "white", "width": 1}}
    places = {"x": (np.arange(BINS) + 0.5) / BINS, "width": 1 / BINS}
    drawn = go.Bar(y=share, name=name, marker=look, error_y=bars(error, color=POSTERIOR), **places)
    return [drawn, line([0, 1], np.full(2, whole / BINS), ideal, MUTED, **DOTTED)]


def transform_shares(transform: Array) -> tuple[Array, Array]:
    """Share of the data in each bin, and its standard error (NaN where there are too few frames).

    Args:
        transform: (frame, entry), NaN where nothing was seen.
    """
    places = np.minimum(np.floor(transform * BINS), BINS - 1)
    found = [mean_interval(np.where(np.isfinite(transform), places == number, np.nan)) for number in range(BINS)]
    return np.array([each.estimate for each in found]), np.array([each.standard_error for each in found])


def mode_chart(modes: Modes) -> go.Figure | None:
    """Probability of each mode over the frames, one upon the other; none where all frames have a single mode."""
    traces = [
        line(modes.frames, 100 * mass, f"mode {number}", color, stackgroup="modes", fillcolor=color, line_width=0)
        for number, (mass, color) in enumerate(zip(modes.masses.T, MODES, strict=False), 1)
    ]
    return chart(traces, "probability (%)", height=220, yaxis_range=[0, 100]) if len(traces) > 1 else None


def _viridis(count: int) -> list[str]:
    return [to_hex(color) for color in colormaps["viridis"](np.linspace(0.0, 0.88, count))]


def _label(tree: xr.DataTree, frame: int, state_dim: int) -> str:
    tau = variable(tree, "diagnostics", "tau")
    factor = f", τ = {tau[frame, state_dim]:.1f}" if tau is not None and np.isfinite(tau[frame, state_dim]) else ""
    return f"{names_of(tree, 'state_dim')[state_dim]}, frame {frame_numbers(tree)[frame]}{factor}"


MAX_NAMES = 4
MAX_LETTERS = 60
"""Length of a name; a longer one is cut in the middle, so that its ending stays."""


def short_names(paths: str) -> str:
    """Name files by as many of their last parts as distinguish them.

    Args:
        paths: Paths, separated by a comma and a space; other words are returned unchanged.

    Returns:
        At most four names, and how many more there are.
    """
    parts = [PurePath(each).parts for each in paths.split(", ")]
    depth, longest = 1, max(map(len, parts))
    while depth < longest and len({each[-depth:] for each in parts}) < len(set(parts)):
        depth += 1
    names = [_cut("/".join(each[-depth:])) for each in parts]
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(names[:MAX_NAMES]) + more


def recording_of(tree: xr.DataTree) -> str:
    """The recording by short names; empty where a result does not name it."""
    return short_names(str(provenance(tree).get("input") or ""))


def title_of(tree: xr.DataTree) -> str:
    """The recording, else the model."""
    return recording_of(tree) or _model(provenance(tree)) or "Posterior of a state-space model"


def algorithms_of(tree: xr.DataTree) -> str:
    """Model, filter and smoother."""
    known = provenance(tree)
    names = [_model(known), *(str(known.get(name) or "") for name in ("filter", "smoother"))]
    return " · ".join(name for name in names if name)


def wrapped(title: str, width: int) -> str:
    """A title on at most two lines of so many letters."""
    return "\n".join(textwrap.wrap(title, width, max_lines=2, placeholder=" …"))


def _model(known: dict[str, Any]) -> str:
    """The model's name, without its module or folder."""
    module, _, name = str(known.get("model") or "").rpartition(":")
    return name if module else short_names(name) if name else ""


def _cut(name: str) -> str:
    half = MAX_LETTERS // 2
    return name if len(name) <= MAX_LETTERS else f"{name[: half - 1]}…{name[-half:]}"
