"""Charts of a model of one's own, under the names of its sites and in their units: its data, and its state.

Units are the result's own, ``attrs={"units": {"level": "m"}}`` of :func:`poseppl.infer`, by site.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics.selection import Array, evenly
from poseppl.report.chart import Traces, band, chart, line
from poseppl.report.picture import MODES, OBSERVED, POSTERIOR, TRUTH
from poseppl.runs.contents import frame_numbers, group_of, names_of
from poseppl.runs.results import provenance

MAX_POINTS, MAX_ENTRIES = 600, 40
LEVELS = (0.05, 0.5, 0.95)


def data_charts(tree: xr.DataTree) -> dict[str, go.Figure]:
    """The data over the frames, by site and entry, on what the posterior predicts of them, where the result tells."""
    seen, predicted = group_of(tree, "observed_data"), group_of(tree, "posterior_predictive")
    made: dict[str, go.Figure] = {}
    for name, number, label in _entries(seen, leading=1):
        values = np.asarray(seen[name].values, float).reshape(seen.sizes["frame"], -1)[:, number]
        if not np.isfinite(values).any():
            continue
        x, chosen = _frames(tree)
        traces: Traces = []
        if name in predicted:
            low, middle, high = np.quantile(_flat(predicted[name])[:, chosen, number], LEVELS, axis=0)
            traces += [*band(x, low, high, "predicted, central 90 %"), line(x, middle, "predicted, median", POSTERIOR)]
        traces.append(line(x, values[chosen], "data", OBSERVED, mode="markers", marker_size=5))
        made |= _drawn(label, traces, _unit(tree, name))
    return made


def site_charts(tree: xr.DataTree) -> dict[str, go.Figure]:
    """Each entry of the state's sites over the frames: its mean on its central 90 % interval, and the truth where known."""
    summary, posterior = group_of(tree, "summary"), group_of(tree, "posterior")
    sites = posterior[[name for name in posterior.data_vars if name != "state"]]
    x, chosen = _frames(tree)
    made: dict[str, go.Figure] = {}
    for name, number, label in _entries(sites, leading=3):
        if f"{name}_probability" in summary:
            shares = summary[f"{name}_probability"].values
            shares = shares.reshape(len(shares), -1, shares.shape[-1])[chosen, number]
            values = names_of(tree, f"{name}_value", "summary")
            colors = [MODES[k % len(MODES)] for k in range(len(values))]
            each = zip(100 * shares.T, values, colors, strict=True)
            lines = [line(x, share, value, color) for share, value, color in each]
            made |= _drawn(label, lines, "probability (%)", yaxis_range=[0, 101])
            continue
        if {f"{name}_mean", f"{name}_quantile"} <= set(summary):
            mean = summary[f"{name}_mean"].values.reshape(len(summary["frame"]), -1)[:, number]
            ends = summary[f"{name}_quantile"].transpose("frame", "quantile", ...).values
            low, high = ends.reshape(*ends.shape[:2], -1)[:, [0, -1], number].T
        else:
            draws = _flat(sites[name])[..., number]
            mean, (low, high) = draws.mean(axis=0), np.quantile(draws, LEVELS[::2], axis=0)
        traces = [*band(x, low[chosen], high[chosen], "central 90 %"), line(x, mean[chosen], "posterior mean", POSTERIOR)]
        made |= _drawn(label, traces + _truth(tree, label, mean, x, chosen), _unit(tree, name))
    return made


def _truth(tree: xr.DataTree, label: str, mean: Array, x: Array, chosen: Array) -> Traces:
    """The truth of an entry that is a coordinate of the flat state: those of bounded sites are on another scale."""
    truth, names = group_of(tree, "truth"), names_of(tree, "dof")
    if "state" not in truth or label not in names:
        return []
    number = names.index(label)
    same = np.allclose(mean, tree["summary"].dataset["state_mean"].values[:, number])
    return [line(x, truth["state"].values[chosen, number], "truth", TRUTH)] if same else []


def _flat(draws: xr.DataArray) -> Array:
    """Draws (draw, frame, entry)."""
    values = draws.transpose("chain", "draw", "frame", ...).values
    return np.asarray(values.reshape(values.shape[0] * values.shape[1], values.shape[2], -1))


def _entries(data: xr.Dataset, leading: int) -> Iterator[tuple[str, int, str]]:
    """Name of each variable, the number of an entry after its leading dimensions, and the entry's name; not too many."""
    left = MAX_ENTRIES
    for name, values in data.data_vars.items():
        rest = values.shape[leading:]
        for number in range(min(int(np.prod(rest)), left)):
            places = np.unravel_index(number, rest) if rest else ()
            dims = zip(values.dims[leading:], places, strict=True)
            told = [str(values[dim].values[place]) if dim in values.coords else str(place) for dim, place in dims]
            yield str(name), number, f"{name}[{', '.join(told)}]" if told else str(name)
            left -= 1


def _drawn(label: str, traces: Traces, unit: str, **more: Any) -> dict[str, go.Figure]:
    layout: dict[str, Any] = {"yaxis_rangemode": "normal", "showlegend": True}
    figure = chart(traces, unit, height=300, **layout | more)
    return {} if figure is None else {label: figure}


def _unit(tree: xr.DataTree, name: str) -> str:
    units = provenance(tree).get("units")
    return str(units.get(name, "")) if isinstance(units, dict) else ""


def _frames(tree: xr.DataTree) -> tuple[Array, Array]:
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_POINTS)
    return frame_numbers(tree)[chosen], chosen
