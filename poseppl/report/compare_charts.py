"""The interactive charts of a comparison, as Plotly's plain data and layout, and what its script draws by itself.

Bounded in size for any length of sequence: heat maps hold at most 300 frames and 60,000 cells, lines at most 600 frames.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.run_figures import FORMULA
from poseppl.diagnostics.selection import Array, evenly
from poseppl.report.chart_parts import AXIS, Chart, escaped, layout_of, line, plain
from poseppl.report.compare_tables import run_colors
from poseppl.report.picture import GRID, MUTED

MAX_FRAMES, MAX_CELLS, MAX_POINTS = 300, 60_000, 600
HEATS = (
    ("tau", "inefficiency factor τ", True, False, (1.0, 300.0)),
    ("ess", "ESS", True, True, (None, None)),
    ("ess_per_second", "ESS a second", True, True, (None, None)),
    ("ess_per_evaluation", "ESS an evaluation", True, True, (None, None)),
    ("rhat", "R-hat", False, False, (1.0, 1.5)),
    ("error_over_sd", "error / standard deviation", False, False, (0.0, 3.0)),
)
"""Of each heat map the figure, its label, whether it is logarithmic, whether more is better, and the ends of its colours."""


def comparison_charts(tree: xr.DataTree) -> dict[str, Chart]:
    """Make the charts that a comparison has data for.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.

    Returns:
        ``data`` and ``layout`` by the name of the chart.
    """
    made = {"cost": _cost(tree), "error": _error(tree), "coverage": _coverage(tree), "progress": _progress(tree)}
    return {name: chart for name, chart in made.items() if chart is not None}


def heat_data(tree: xr.DataTree) -> dict[str, Any]:
    """Collect what the heat maps over frames and coordinates show, one panel a run.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.

    Returns:
        Plain lists; ``values`` (run, dof, frame) of every figure that a run has.
    """
    figures = tree["figures"].dataset
    sizes = figures.sizes
    chosen = evenly(sizes["frame"], max(2, min(MAX_FRAMES, MAX_CELLS // (sizes["run"] * sizes["dof"]))))
    quantities = []
    for name, label, logarithmic, more_is_better, ends in HEATS:
        values = figures[name].transpose("run", "dof", "frame").values[:, :, chosen]
        finite = values[np.isfinite(values) & (values > 0 if logarithmic else True)]
        if not finite.size:
            continue
        low, high = (float(form(finite)) if end is None else end for form, end in zip((np.min, np.max), ends, strict=True))
        high = max(high, 10 * low) if logarithmic else high
        shared = {"key": name, "label": label, "log": logarithmic, "reverse": more_is_better}
        quantities.append(shared | {"low": low, "high": high, "values": plain(values, 3)})
    return {
        "frames": figures["frame"].values[chosen].tolist(),
        "dofs": [escaped(str(name)) for name in figures["dof"].values],
        "runs": _labels(tree),
        "colors": run_colors(sizes["run"]),
        "formula": [str(kind) == FORMULA for kind in figures["kind"].values],
        "quantities": quantities,
    }


def variance_data(tree: xr.DataTree) -> dict[str, Any] | None:
    """Collect the variance of the mean against time, one point a setting.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.

    Returns:
        Plain lists, ``variance`` and ``error`` (place, setting) for all coordinates and for each; None without any point.
    """
    data = tree["variance"].dataset
    variance = np.concatenate([data["variance"].values[None], data["variance_by_dof"].values.T])
    error = np.concatenate([data["variance_se"].values[None], data["variance_by_dof_se"].values.T])
    usable = np.isfinite(data["seconds"].values) & (data["seconds"].values > 0)
    variance = np.where((variance > 0) & usable, variance, np.nan)
    if not np.isfinite(variance).any():
        return None
    runs = tree["figures"].dataset["run"].values.tolist()
    first = [runs.index(name) for name in data["setting"].values.tolist()]
    return {
        "names": [_labels(tree)[index] for index in first],
        "methods": [escaped(str(name)) for name in data["method"].values],
        "disqualified": [bool(tree["summary"].dataset["disqualified"].values[index]) for index in first],
        "colors": [run_colors(len(runs))[index] for index in first],
        "replicates": data["replicates"].values.tolist(),
        "seconds": plain(data["seconds"].values),
        "seconds_error": plain(data["seconds_se"].values),
        "places": ["all coordinates", *(str(name) for name in data["dof"].values)],
        "variance": plain(variance),
        "error": plain(error),
    }


def _names(tree: xr.DataTree) -> list[str]:
    return [escaped(str(name)) for name in tree["figures"].dataset["run"].values]


def _labels(tree: xr.DataTree) -> list[str]:
    """Names of the runs where ESS is shown, with a warning on those whose posterior is wrong."""
    out = tree["summary"].dataset["disqualified"].values
    return [f"{name} (disqualified)" if wrong else name for name, wrong in zip(_names(tree), out, strict=True)]


def _cost(tree: xr.DataTree) -> Chart | None:
    """ESS a second and an evaluation of each coordinate: the harmonic mean, and the middle 90 % of the frames."""
    figures, summary = tree["figures"].dataset, tree["summary"].dataset
    names = _labels(tree)
    rows = np.arange(figures.sizes["dof"])
    taking_part = np.isfinite(summary["ess"].values).any(axis=1)
    slot = np.cumsum(taking_part) - 0.5
    data: list[dict[str, Any]] = []
    columns = [name for name in ("ess_per_second", "ess_per_evaluation") if np.isfinite(summary[name].values).any()]
    for place, column in enumerate(columns):
        for index, (name, color) in enumerate(zip(names, run_colors(len(names)), strict=True)):
            value = summary[column].values[index]
            if not np.isfinite(value).any():
                continue
            low, high = _middle(figures[column].values[index])
            bars = {"type": "data", "symmetric": False, "array": plain(high - value), "arrayminus": plain(value - low)}
            point = {
                "type": "scatter",
                "mode": "markers",
                "x": plain(value),
                "y": plain(rows - 0.4 + 0.8 * slot[index] / taking_part.sum()),
                "text": [escaped(str(dof)) for dof in figures["dof"].values],
                "name": name,
                "legendgroup": name,
                "showlegend": name not in {trace["name"] for trace in data},
                "xaxis": f"x{place + 1 if place else ''}",
                "marker": {"color": color, "size": 7},
                "error_x": bars | {"color": color, "thickness": 1, "width": 0},
                "hovertemplate": f"%{{text}}: %{{x:.3g}}<extra>{name}</extra>",
            }
            data.append(point)
    if not data:
        return None
    layout = _cost_layout(figures, columns)
    for name in ("x", "x2")[: len(columns)]:
        layout[name.replace("x", "xaxis")] |= _log_axis([x for trace in data if trace["xaxis"] == name for x in trace["x"]])
    return {"data": data, "layout": layout}


def _log_axis(values: Any) -> dict[str, Any]:
    """A logarithmic axis with labels at powers of ten, at 2 and 5 times them too where it is short."""
    known = np.array([value for value in values if value is not None and value > 0])
    short = np.log10(known.max() / known.min()) < 2 if known.size else True
    return {"type": "log", "dtick": "D2" if short else 1, "exponentformat": "power"}


def _middle(values: Array) -> tuple[Array, Array]:
    """The middle 90 % of frames, (dof,) each."""
    empty = ~np.isfinite(values).any(axis=0)
    low, high = np.nanquantile(np.where(empty, 1.0, values), [0.05, 0.95], axis=0)
    return np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def _cost_layout(figures: xr.Dataset, columns: list[str]) -> dict[str, Any]:
    titles = {"ess_per_second": "ESS a second", "ess_per_evaluation": "ESS an evaluation of likelihood or gradient"}
    dofs, runs = figures.sizes["dof"], figures.sizes["run"]
    layout = layout_of("", height=110 + dofs * (10 + 4 * min(runs, 8)), hovermode="closest")
    labels = [escaped(str(name)) for name in figures["dof"].values]
    ticks = {"tickmode": "array", "tickvals": list(range(dofs)), "ticktext": labels, "tickfont": {"size": 10}}
    layout["yaxis"] = AXIS | ticks | {"range": [dofs - 0.5, -0.5], "automargin": True, "showgrid": False}
    layout["shapes"] = [
        {
            "type": "rect",
            "xref": "paper",
            "x0": 0,
            "x1": 1,
            "y0": row - 0.5,
            "y1": row + 0.5,
            "fillcolor": GRID,
            "layer": "below",
        }
        | {"opacity": 0.5, "line": {"width": 0}}
        for row in range(0, dofs, 2)
    ]
    for place, column in enumerate(columns):
        domain = [0.0, 1.0] if len(columns) == 1 else [0.52 * place, 0.48 + 0.52 * place]
        layout[f"xaxis{place + 1 if place else ''}"] = AXIS | {"title": {"text": titles[column]}, "domain": domain}
    return layout


def _error(tree: xr.DataTree) -> Chart | None:
    figures = tree["figures"].dataset
    values = figures["joint_error"].transpose("run", "frame").values
    if not np.isfinite(values).any():
        return None
    return {"data": _lines(tree, values), "layout": layout_of("mean joint error (mm)", height=340)}


def _lines(tree: xr.DataTree, values: Array, **more: Any) -> list[dict[str, Any]]:
    """One line a run with values (run, frame)."""
    chosen = evenly(values.shape[1], MAX_POINTS)
    x = tree["figures"].dataset["frame"].values[chosen].tolist()
    rows = zip(values, _names(tree), run_colors(len(values)), strict=True)
    return [line(x, row[chosen], name, color, **more) for row, name, color in rows if np.isfinite(row).any()]


def _coverage(tree: xr.DataTree) -> Chart | None:
    summary = tree["summary"].dataset
    share, error = summary["coverage_all"].values, summary["coverage_se_all"].values
    if not np.isfinite(share).any():
        return None
    levels, names = 100 * summary["level"].values, _names(tree)
    data = [line([40, 100], np.array([40.0, 100.0]), "ideal", MUTED, line={"color": MUTED, "width": 1, "dash": "dot"})]
    offsets = min(0.9, 8 / len(names)) * (np.arange(len(names)) - (len(names) - 1) / 2)
    for index, (name, color) in enumerate(zip(names, run_colors(len(names)), strict=True)):
        if np.isfinite(share[index]).any():
            bars = {"type": "data", "array": plain(200 * error[index]), "color": color, "thickness": 1.5}
            dots = {"mode": "markers", "marker": {"size": 8, "color": color}, "error_y": bars}
            data.append(line(plain(levels + offsets[index]), 100 * share[index], name, color, **dots))
    layout = layout_of("truth inside (%)", height=340, hovermode="closest", showlegend=False)
    layout["xaxis"] = layout["xaxis"] | {"title": {"text": "nominal level (%)"}, "range": [44, 97], "tickvals": [50, 80, 90]}
    layout["yaxis"] = layout["yaxis"] | {"range": [0, 102]}
    return {"data": data, "layout": layout}


def _progress(tree: xr.DataTree) -> Chart | None:
    """Mean tau over the coordinates, largest R-hat and rejection over the frames, one panel below the other."""
    figures = tree["figures"].dataset
    panels = [
        ("mean τ", _over_dofs(figures["tau"].values, np.mean), "log"),
        ("largest R-hat", _over_dofs(figures["rhat"].values, np.max), "linear"),
        ("rejected (%)", 100 * figures["rejection"].values, "linear"),
    ]
    panels = [panel for panel in panels if np.isfinite(panel[1]).any()]
    if not panels:
        return None
    layout = layout_of("", height=70 + 150 * len(panels))
    base = layout.pop("yaxis")
    data: list[dict[str, Any]] = []
    for number, (label, values, kind) in enumerate(panels):
        suffix, top = "" if number == 0 else str(number + 1), 1 - number / len(panels)
        axis = {"title": {"text": label, "font": {"size": 11}}, "domain": [max(0.0, top - 0.86 / len(panels)), top]}
        layout[f"yaxis{suffix}"] = base | axis | {"automargin": True, "rangemode": "normal"}
        if kind == "log":
            layout[f"yaxis{suffix}"] |= _log_axis(values[np.isfinite(values)])
        named = {trace["name"] for trace in data}
        traces = _lines(tree, values, yaxis=f"y{suffix}")
        data += [trace | {"legendgroup": trace["name"], "showlegend": trace["name"] not in named} for trace in traces]
    layout["xaxis"] = layout["xaxis"] | {"anchor": f"y{'' if len(panels) == 1 else len(panels)}"}
    return {"data": data, "layout": layout}


def _over_dofs(values: Array, form: Any) -> Array:
    """Reduce (run, frame, dof) over the coordinates that have a figure."""
    finite = np.isfinite(values)
    filled = np.where(finite, values, 0.0)
    reduced = filled.sum(axis=2) / np.maximum(finite.sum(axis=2), 1) if form is np.mean else filled.max(axis=2)
    return np.where(finite.any(axis=2), reduced, np.nan)
