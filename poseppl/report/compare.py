"""The comparison of runs as one HTML file that opens without a network, as a CSV table, and its charts.

Bounded in size for any length of sequence: heat maps have at most 300 frames and 60,000 cells, lines at most 600 frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics import comparison_table
from poseppl.diagnostics.paired_comparison import QUANTITIES
from poseppl.diagnostics.run_figures import FORMULA
from poseppl.diagnostics.selection import Array, evenly
from poseppl.diagnostics.verdicts.comparison import findings, wins, words
from poseppl.errors import FilePath
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.report.chart import (
    Panel,
    Traces,
    bars,
    chart,
    color_axis,
    coverage_chart,
    grid,
    heat,
    line,
    log_axis,
    points,
    scatter,
    stack,
)
from poseppl.report.compare_tables import (
    coordinates_table,
    forecast_runs,
    forecasts_table,
    runs_table,
    settings_table,
    shown_runs,
    winners_table,
)
from poseppl.report.page import page_html
from poseppl.report.picture import GRID
from poseppl.runs.contents import group_of


def write_comparison(tree: xr.DataTree, path: FilePath) -> None:
    """Write the page of a comparison.

    Args:
        tree: The tree of :func:`poseppl.diagnostics.compare`.
        path: The HTML file, overwritten if it exists; it appears when it is whole.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    write_atomically(path, comparison_html(tree))


def write_comparison_table(tree: xr.DataTree, path: FilePath) -> None:
    """Write every figure as CSV, one row for each run, frame and degree of freedom; an empty field is no figure.

    Arguments and errors are those of :func:`write_comparison`.
    """
    rows = comparison_table(tree)
    cells = ([f"{value:.6g}" if isinstance(value, float) else value for value in row.values()] for row in rows)
    write_rows(path, [rows[0].keys(), *cells])


def comparison_html(tree: xr.DataTree) -> str:
    """Make the page of a comparison (of :func:`poseppl.diagnostics.compare`)."""
    figures, drawn = tree["figures"].dataset, comparison_charts(tree) | {"forecasts": forecast_charts(tree)}
    sizes = figures.sizes
    return page_html(
        "comparison.html",
        title=f"{sizes['run']} runs compared",
        subtitle=f"{words(figures['run'].values.tolist())} · {sizes['frame']} frames · {sizes['state_dim']} coordinates",
        cards=[card for quantity in QUANTITIES for card in _cards(tree, quantity)],
        data={"charts-data": drawn},
        charts=drawn,
        found=findings(tree),
        runs=runs_table(tree),
        winners=winners_table(tree),
        by_coordinate=coordinates_table(tree),
        forecasts_shown=forecasts_table(tree),
        num_sites=group_of(tree, "forecasts").sizes.get("site", 0),
        num_shown=len(list(forecast_runs(tree))),
        settings=settings_table(tree),
    )


def _cards(tree: xr.DataTree, quantity: str) -> Iterator[tuple[str, str]]:
    """The winner of a quantity, and how many coordinates each run wins; nothing where fewer than two runs have it."""
    winner = str(tree["winner"].dataset["winner"].sel(quantity=quantity).item())
    counts = ", ".join(f"{name} {count}" for name, count in wins(tree, quantity).items())
    if winner:
        yield winner, f"{QUANTITIES[quantity]} · by coordinate: {counts}" if counts else QUANTITIES[quantity]


MAX_FRAMES, MAX_CELLS = 300, 60_000
HEATS = (
    ("tau", "inefficiency factor τ", True, False, (1.0, 300.0)),
    ("ess", "ESS", True, True, (None, None)),
    ("ess_per_second", "ESS per second", True, True, (None, None)),
    ("ess_per_evaluation", "ESS per evaluation", True, True, (None, None)),
    ("rhat", "R-hat", False, False, (1.0, 1.5)),
    ("error_over_sd", "error / standard deviation", False, False, (0.0, 3.0)),
)
"""For each heat map: the figure, its label, whether it is logarithmic, whether more is better, and the ends of its colours."""
COSTS = {"ess_per_second": "ESS per second", "ess_per_evaluation": "ESS per evaluation"}


def comparison_charts(tree: xr.DataTree) -> dict[str, Any]:
    """Make the charts that a comparison (of :func:`poseppl.diagnostics.compare`) has data for, by name."""
    made = {"cost": _cost(tree), "error": _error(tree), "coverage": _coverage(tree), "progress": _progress(tree)}
    made["autocorrelation"] = _autocorrelation(tree)
    return {name: each for name, each in made.items() if each} | {"heat": heat_maps(tree), "variance": variance_charts(tree)}


def heat_maps(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """Colour every figure that a run has over frames and coordinates, one panel a run."""
    figures = tree["figures"].dataset
    sizes = figures.sizes
    chosen = evenly(sizes["frame"], max(2, min(MAX_FRAMES, MAX_CELLS // (sizes["run"] * sizes["state_dim"]))))
    columns = min(sizes["run"], 2) if sizes["run"] <= 4 else 3
    height = -(-sizes["run"] // columns) * (62 + 11 * min(60, max(8, sizes["state_dim"]))) + 20
    layout: dict[str, Any] = {
        "columns": columns,
        "height": height,
        "margin": {"l": 96, "r": 20, "t": 26, "b": 26},
        "hovermode": "closest",
    }
    maps = {}
    for name, label, logarithmic, more_is_better, ends in HEATS:
        values = figures[name].transpose("run", "state_dim", "frame").values[:, :, chosen]
        finite = values[np.isfinite(values) & (values > 0 if logarithmic else True)]
        if not finite.size:
            continue
        low, high = (float(form(finite)) if end is None else end for form, end in zip((np.min, np.max), ends, strict=True))
        high = max(high, 10 * low) if logarithmic else high
        axis = color_axis(low, high, label, logarithmic=logarithmic, dark_is_bad=not more_is_better)
        maps[label] = grid(list(_heat_panels(tree, values, chosen, label, logarithmic, columns)), coloraxis=axis, **layout)
    return maps


def _heat_panels(
    tree: xr.DataTree, values: Array, chosen: Array, label: str, logarithmic: bool, columns: int
) -> Iterator[Panel]:
    """Heat maps of values (run, state_dim, frame) at the chosen frames."""
    figures = tree["figures"].dataset
    frames, dofs = figures["frame"].values[chosen], figures["state_dim"].values.tolist()
    half = (frames[1] - frames[0]) / 2 if len(frames) > 1 else 0.5
    xaxis = {"showgrid": False, "nticks": 6, "tickfont_size": 10, "range": [frames[0] - half, frames[-1] + half]}
    yaxis = {"type": "category", "categoryarray": dofs, "range": [len(dofs) - 0.5, -0.5]}  # named in an empty panel, too
    yaxis |= {"showgrid": False, "ticks": "", "tickfont_size": 9}
    yaxis |= {} if len(dofs) > 60 else {"dtick": 1}
    for index, run in enumerate(shown_runs(tree)):
        why = "closed form: no Monte Carlo error" if figures["kind"].values[index] == FORMULA else "no figure"
        drawn = heat(frames, dofs, values[index], label, run.label, logarithmic=logarithmic)
        beside = {"showticklabels": index % columns == 0}
        yield Panel([drawn], run.label, yaxis | beside, xaxis, run.color, "" if np.isfinite(values[index]).any() else why)


def _cost(tree: xr.DataTree) -> go.Figure | None:
    """ESS per second and per evaluation of each coordinate: the harmonic mean, and the middle 90 % of the frames."""
    figures, summary = tree["figures"].dataset, tree["summary"].dataset
    runs, dofs = shown_runs(tree), figures["state_dim"].values.tolist()
    taking_part = np.isfinite(summary["ess"].values).any(axis=1)
    slot = 0.8 * (np.cumsum(taking_part) - 0.5) / max(taking_part.sum(), 1) - 0.4
    template = "%{text}: %{x:.3g}<extra>%{fullData.name}</extra>"
    style = {"marker_size": 7, "text": dofs, "hovertemplate": template}
    panels: list[Panel] = []
    for column, title in COSTS.items():
        traces: Traces = []
        for index, (run, value) in enumerate(zip(runs, summary[column].values, strict=True)):
            if np.isfinite(value).any():
                low, high = _middle(figures[column].values[index])
                ends = bars(high - value, value - low, color=run.color, thickness=1, width=0)
                traces.append(scatter(value, np.arange(len(dofs)) + slot[index], run.label, run.color, error_x=ends, **style))
        if traces:
            yaxis = {"tickvals": list(range(len(dofs))), "ticktext": dofs, "tickfont_size": 10, "automargin": True}
            yaxis |= {"range": [len(dofs) - 0.5, -0.5], "showgrid": False, "showticklabels": not panels}
            known = np.concatenate(
                [trace.x + end for trace in traces for end in (trace.error_x.array, -trace.error_x.arrayminus)]
            )
            panels.append(Panel(traces, "", yaxis, log_axis(title, known)))
    shade = {"xref": "paper", "x0": 0, "x1": 1, "fillcolor": GRID, "layer": "below", "opacity": 0.5, "line_width": 0}
    rows = [shade | {"y0": row - 0.5, "y1": row + 0.5} for row in range(0, len(dofs), 2)]
    height = 110 + len(dofs) * (10 + 4 * min(len(runs), 8))
    return grid(panels, columns=len(panels), height=height, hovermode="closest", shapes=rows)


def _middle(values: Array) -> tuple[Array, Array]:
    """The middle 90 % of frames, (state_dim,) each."""
    empty = ~np.isfinite(values).any(axis=0)
    low, high = np.nanquantile(np.where(empty, 1.0, values), [0.05, 0.95], axis=0)
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def _lines(tree: xr.DataTree, values: Array) -> Traces:
    """One line a run with values (run, frame)."""
    frames, rows = tree["figures"].dataset["frame"].values, zip(values, shown_runs(tree), strict=True)
    return [line(frames, row, run.name, run.color) for row, run in rows if np.isfinite(row).any()]


def _error(tree: xr.DataTree) -> go.Figure | None:
    values = tree["figures"].dataset["joint_error"].transpose("run", "frame").values
    return chart(_lines(tree, values), "mean joint error, mm", height=340)


def _autocorrelation(tree: xr.DataTree) -> go.Figure | None:
    """Autocorrelation of each run's coordinate that mixes worst."""
    tau, rho = tree["summary"].dataset["tau"].fillna(0), tree["figures"].dataset["autocorrelation"]
    worst = tau.argmax("state_dim")
    traces = [
        line(rho["lag"].values, each, f"{run.name}: {tau['state_dim'].values[at]}", run.color)
        for each, run, at in zip(rho.isel(state_dim=worst).values, shown_runs(tree), worst.values, strict=True)
        if np.isfinite(each).any()
    ]
    return chart(traces, "", xlabel="lag (draws)", yaxis_rangemode="normal")


def _coverage(tree: xr.DataTree) -> go.Figure | None:
    summary, runs = tree["summary"].dataset, shown_runs(tree)
    share, error = 100 * summary["coverage_all"].values, 100 * summary["coverage_se_all"].values
    offsets = min(0.9, 8 / len(runs)) * (np.arange(len(runs)) - (len(runs) - 1) / 2)
    rows = [
        points(100 * summary["level"].values + offsets[index], share[index], run.name, run.color, error[index])
        for index, run in enumerate(runs)
        if np.isfinite(share[index]).any()
    ]
    return coverage_chart(rows, height=340, showlegend=False)


def _progress(tree: xr.DataTree) -> go.Figure | None:
    """Mean tau over the coordinates, largest R-hat and rejection over the frames, one panel below the other."""
    figures = tree["figures"].dataset
    found = {
        "mean τ": figures["tau"].mean("state_dim").values,
        "largest R-hat": figures["rhat"].max("state_dim").values,
        "rejected (%)": 100 * figures["rejection"].values,
    }
    panels = [
        Panel(_lines(tree, values), label, log_axis("", values) if label == "mean τ" else {})
        for label, values in found.items()
        if np.isfinite(values).any()
    ]
    return stack(panels, height=150)


def forecast_charts(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """The score over the frames ahead, with bars of two standard errors, by data site."""
    made = {}
    for site, runs in forecast_runs(tree):
        traces = []
        for run, at in runs:
            ends = bars(2 * at["crps_error"].values, color=run.color)
            traces.append(scatter(at["lead"], at["crps"].values, run.name, run.color, mode="lines+markers", error_y=ends))
        made[site] = chart(traces, f"CRPS of {site}", xlabel="frames ahead", height=300, showlegend=True)
    return made


def variance_charts(tree: xr.DataTree) -> dict[str, go.Figure]:
    """Draw the variance of the mean against time, one point a setting: of all coordinates together, and of each."""
    data = tree["variance"].dataset
    values, errors = (
        np.column_stack([data[name + end] for name in ("variance", "variance_by_state_dim")]) for end in ("", "_se")
    )
    seconds = data["seconds"].values[:, None]
    values = np.where(np.isfinite(seconds) & (seconds > 0) & (np.nan_to_num(values) > 0), values, np.nan)
    if np.isnan(values).all():
        return {}
    places = ["all coordinates", *data["state_dim"].values.tolist()]
    return {place: _variance(tree, values[:, k], errors[:, k]) for k, place in enumerate(places)}


def _variance(tree: xr.DataTree, variance: Array, error: Array) -> go.Figure:
    """One line a method through its settings, and through its best the line along which variance times time is the same."""
    data, runs = tree["variance"].dataset, {run.name: run for run in shown_runs(tree)}
    first = [runs[name] for name in data["setting"].values.tolist()]
    seconds, seconds_error, seeds = (data[name].values for name in ("seconds", "seconds_se", "replicates"))
    methods = [str(name) or run.label for name, run in zip(data["method"].values, first, strict=True)]
    traces: Traces = []
    for method in dict.fromkeys(methods):
        members = [i for i in np.argsort(seconds, kind="stable") if methods[i] == method and np.isfinite(variance[i])]
        if not members:
            continue
        color = first[members[0]].color
        style: dict[str, Any] = {
            "mode": "lines+markers" if len(members) > 1 else "markers",
            "line_width": 1,
            "marker": {"size": 11, "line": {"width": 2, "color": color}, "color": color},
            "marker_symbol": ["circle" if seeds[i] > 1 else "circle-open" for i in members],
            "text": [f"{first[i].label}, {f'{seeds[i]} seeds' if seeds[i] > 1 else 'one seed'}" for i in members],
            "hovertemplate": "%{text}<br>%{x:.3g} s a frame, variance %{y:.3g}<extra></extra>",
            "error_x": _bars(seconds[members], seconds_error[members]),
            "error_y": _bars(variance[members], error[members]),
            "showlegend": True,
        }
        name = f"{method} (miscalibrated)" if all(first[i].label != first[i].name for i in members) else method
        traces.append(scatter(seconds[members], variance[members], name, color, **style))
    return go.Figure(traces, _variance_layout(traces))


def _variance_layout(traces: Traces) -> dict[str, Any]:
    if not traces:
        return {"height": 430}
    x = np.concatenate([trace.x for trace in traces])
    ends = [end for trace in traces for end in (trace.y + trace.error_y.array, trace.y - trace.error_y.arrayminus)]
    low, high = x.min() / 2, 2 * x.max()
    shared = {"type": "line", "x0": low, "x1": high, "layer": "below", "opacity": 0.5, "line_width": 1, "line_dash": "dot"}
    costs = [(float(np.min(trace.x * trace.y)), trace.line.color) for trace in traces]
    return {
        "height": 430,
        "hovermode": "closest",
        "margin": {"l": 70, "r": 16, "t": 12, "b": 48},
        "shapes": [shared | {"y0": cost / low, "y1": cost / high, "line_color": color} for cost, color in costs],
        "xaxis": log_axis("seconds a frame", x),
        "yaxis": log_axis("variance of the mean / posterior variance", np.concatenate(ends)),
    }


def _bars(values: Array, errors: Array) -> dict[str, Any]:
    """Both ends of a bar of two standard errors of the logarithm; none where the error is not known."""
    factor = np.exp(np.minimum(np.nan_to_num(2 * errors / values), 12))
    return bars(values * (factor - 1), values - values / factor, thickness=1.2, width=3)
