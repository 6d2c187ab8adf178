"""The interactive charts of the report, as Plotly's plain data and layout: error, mixing, evidence, and every coordinate."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array, evenly, expected_error, frame_numbers, variable
from poseppl.report.chart_parts import Chart, escaped, layout_of, line, plain
from poseppl.report.picture import BAND, MUTED, OBSERVED, POSTERIOR, TRUTH
from poseppl.report.prediction_chart import prediction_chart
from poseppl.runs.results import is_weighted

MAX_POINTS = 600
_NO_LINE = {"width": 0}


def charts(tree: xr.DataTree) -> dict[str, Chart]:
    """Make the charts that a result has data for.

    Args:
        tree: A diagnosed result.

    Returns:
        ``data`` and ``layout`` by the name of the chart.
    """
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_POINTS)
    made = {
        "error": _error(tree, chosen),
        "coverage": _coverage(tree),
        "inefficiency": _inefficiency(tree, chosen),
        "progress": _progress(tree, chosen),
        "predictions": prediction_chart(tree),
    }
    return {name: chart for name, chart in made.items() if chart is not None}


def coordinate_data(tree: xr.DataTree) -> dict[str, Any]:
    """Collect mean, central 90 % interval and truth of every coordinate over the frames.

    Args:
        tree: The result.

    Returns:
        Plain lists, (dof, frame) each, ready for JSON.
    """
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_POINTS)
    summary, truth = tree["summary"].dataset, variable(tree, "truth", "state")
    quantile = summary["state_quantile"].values if "state_quantile" in summary else None
    return {
        "frames": frame_numbers(tree)[chosen].tolist(),
        "names": [str(name) for name in tree["posterior"].dataset["dof"].values],
        "mean": plain(summary["state_mean"].values[chosen].T),
        "low": None if quantile is None else plain(quantile[chosen, 0].T),
        "high": None if quantile is None else plain(quantile[chosen, -1].T),
        "truth": None if truth is None else plain(truth[chosen].T),
    }


def _error(tree: xr.DataTree, chosen: Array) -> Chart | None:
    band, error = expected_error(tree), variable(tree, "diagnostics", "joint_error")
    relative = variable(tree, "diagnostics", "joint_error_relative")
    if band is None:
        return None
    x = frame_numbers(tree)[chosen].tolist()
    data = [
        line(x, band[2][chosen], "posterior expects, 95 %", BAND, line=_NO_LINE, showlegend=False),
        line(x, band[0][chosen], "posterior expects (90 %)", BAND, line=_NO_LINE, fill="tonexty", fillcolor=BAND),
    ]
    if error is not None and relative is not None:
        data.append(line(x, error.mean(axis=1)[chosen], "error against the truth", TRUTH))
        data.append(line(x, relative.mean(axis=1)[chosen], "error relative to the root", OBSERVED))
    return {"data": data, "layout": layout_of("mm")}


def _coverage(tree: xr.DataTree) -> Chart | None:
    levels = variable(tree, "diagnostics", "level")
    if levels is None:
        return None
    data: list[dict[str, Any]] = []
    for name, label, color in (("coverage", "state", POSTERIOR), ("coverage_markers", "markers", OBSERVED)):
        share, error = variable(tree, "diagnostics", name), variable(tree, "diagnostics", f"{name}_se")
        if share is None or error is None or not np.isfinite(share).all():
            continue
        bars = {"type": "data", "array": plain(200 * error), "color": color, "thickness": 1.5}
        point = {"size": 9, "color": color}
        data.append(
            line(
                plain(100 * levels),
                100 * share,
                f"{label} (± 2 standard errors)",
                color,
                error_y=bars,
                mode="markers",
                marker=point,
            )
        )
    if not data:
        return None
    ideal = {"color": MUTED, "width": 1, "dash": "dot"}
    data.insert(0, line([40, 100], np.array([40.0, 100.0]), "ideal", MUTED, line=ideal, hoverinfo="skip"))
    layout = layout_of("truth inside (%)", hovermode="closest")
    layout["xaxis"] = layout["xaxis"] | {"title": {"text": "nominal level (%)"}, "range": [44, 96], "tickvals": [50, 80, 90]}
    layout["yaxis"] = layout["yaxis"] | {"range": [0, 102]}
    return {"data": data, "layout": layout}


def _inefficiency(tree: xr.DataTree, chosen: Array) -> Chart | None:
    tau = variable(tree, "diagnostics", "tau")
    if is_weighted(tree) or tau is None or np.isnan(tau).all():
        return None
    names = [str(name) for name in tree["posterior"].dataset["dof"].values]
    shown = np.maximum(tau[chosen].T, 1e-3)
    top = max(float(np.log10(np.nanmax(tau))), 1.0)
    ticks = [value for value in (1, 3, 10, 30, 100, 300, 1000) if np.log10(value) <= top]
    heat = {
        "type": "heatmap",
        "x": frame_numbers(tree)[chosen].tolist(),
        "y": [escaped(name) for name in names],
        "z": plain(np.log10(shown)),
        "customdata": plain(tau[chosen].T),
        "hovertemplate": "%{y}, frame %{x}<br>τ = %{customdata:.1f}<extra></extra>",
        "zmin": 0,
        "zmax": top,
        "colorscale": "YlGnBu",
        "reversescale": True,
        "colorbar": {
            "title": {"text": "τ"},
            "tickvals": np.log10(ticks).tolist(),
            "ticktext": [str(t) for t in ticks],
            "thickness": 12,
        },
    }
    layout = layout_of("", height=130 + 17 * max(len(names), 6), hovermode="closest")
    layout["yaxis"] = {"autorange": "reversed", "automargin": True, "tickfont": {"size": 10}, "type": "category"}
    layout["margin"] = layout["margin"] | {"l": 110}
    return {"data": [heat], "layout": layout}


def _progress(tree: xr.DataTree, chosen: Array) -> Chart | None:
    """Evidence, effective size and rejection over the frames, one panel below the other."""
    x = frame_numbers(tree)[chosen].tolist()
    panels: list[tuple[str, Array]] = []
    evidence = variable(tree, "sample_stats", "log_evidence")
    if evidence is not None and np.isfinite(evidence).any():
        panels.append(("log evidence", evidence))
    ess = variable(tree, "diagnostics", "ess")
    if ess is not None and np.isfinite(ess).any():
        least = np.where(np.isfinite(ess), ess, np.inf).min(axis=1)
        label = "effective number" if is_weighted(tree) else "least ESS"
        panels.append((label, np.where(np.isfinite(least), least, np.nan)))
    for name, label in (("unique_ancestors", "unique ancestors"), ("step_size", "step size")):
        found = variable(tree, "sample_stats", name)
        if (
            found is not None
            and np.isfinite(found).any()
            and (name == "unique_ancestors" or np.ptp(found[np.isfinite(found)]) > 0)
        ):
            panels.append((label, found))
    rejection = variable(tree, "diagnostics", "rejection_rate")
    if rejection is not None and not is_weighted(tree):
        panels.append(("rejection (%)", 100 * rejection))
    if not panels:
        return None
    layout = layout_of("", height=60 + 130 * len(panels), showlegend=False)
    base = layout.pop("yaxis")
    data = []
    for number, (label, values) in enumerate(panels):
        suffix = "" if number == 0 else str(number + 1)
        top = 1 - number / len(panels)
        domain = [max(0.0, top - 0.86 / len(panels)), top]
        layout[f"yaxis{suffix}"] = base | {
            "title": {"text": label, "font": {"size": 11}},
            "domain": domain,
            "rangemode": "normal" if label == "log evidence" else "tozero",
            "automargin": True,
        }
        data.append(line(x, values[chosen].astype(float), label, POSTERIOR, yaxis=f"y{suffix}"))
    layout["xaxis"] = layout["xaxis"] | {"anchor": f"y{'' if len(panels) == 1 else len(panels)}"}
    return {"data": data, "layout": layout}
