"""The report of a run: one HTML file that contains everything; and the charts of a model of your own, by its sites.

Bounded in size for any length of sequence: the slider shows at most 120 frames with 20 draws each, charts at most 600 frames.

Units are the result's own, ``attrs={"units": {"level": "m"}}`` of :func:`poseppl.infer`, by site.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle, islice
from typing import Any

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics import verdicts
from poseppl.diagnostics.diagnosis import diagnosed, extension_of
from poseppl.diagnostics.efficiency import RHAT_SHARE, disagreement
from poseppl.diagnostics.modes import modes_over_time
from poseppl.diagnostics.run_figures import is_sampled
from poseppl.diagnostics.selection import Array, provenance_table
from poseppl.diagnostics.verdicts.predictive import rank_test
from poseppl.diagnostics.verdicts.verdict import Verdict
from poseppl.errors import FilePath, Wording
from poseppl.files.atomic_writing import write_atomically
from poseppl.report.chart import Traces, chart, fan, line
from poseppl.report.charts import algorithms_of, charts, mode_chart, title_of
from poseppl.report.page import Extension, page_html
from poseppl.report.picture import MODES, OBSERVED, TRUTH
from poseppl.report.tables import ambiguity_table, cards, inefficiency_table, settings_table, worst_frames_table
from poseppl.runs.contents import frame_numbers, group_of, names_of, variable
from poseppl.runs.results import is_weighted


def write_report(tree: xr.DataTree, path: FilePath, *, name: Wording = str) -> None:
    """Write the report of a result.

    Args:
        tree: The result; diagnosed first if it has no group ``diagnostics``.
        path: The HTML file, overwritten if it exists; it appears when it is whole.
        name: How verdicts name the argument of a remedy; as in Python by default.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    write_atomically(path, report_html(tree, name))


def report_html(tree: xr.DataTree, name: Wording = str) -> str:
    """Make the report of a result, the whole page; see :func:`write_report`."""
    whole = diagnosed(tree)
    package = extension_of(whole, "report")
    own, more = package is None, Extension("") if package is None else package.extension(whole)
    modes = modes_over_time(whole) if more.modes is None else more.modes
    sites = {"data": data_charts(whole), "coordinates": site_charts(whole)} if own else {}
    besides: dict[str, Any] = {"modes": mode_chart(modes), **sites, **more.charts}
    drawn = charts(whole) | {title: each for title, each in besides.items() if each}
    apart = disagreement(whole["diagnostics"].dataset.get("rhat", np.nan))
    return page_html(
        "report.html",
        more.package,
        title=title_of(whole),
        subtitle=algorithms_of(whole),
        cards=cards(whole, more.cards),
        data={"charts-data": drawn} | dict(more.data),
        charts=drawn,
        found=[Verdict(each.severity, each.worded(name)) for each in verdicts(whole)],
        own=own,
        most_entries=MAX_ENTRIES,
        predicted="posterior_predictive" in whole.children,
        known="truth" in whole.children,
        weighted=is_weighted(whole),
        sampled=is_sampled(whole),
        uniform=float(whole["diagnostics"].dataset["tau"].max()),
        apart=apart if apart > RHAT_SHARE else 0.0,
        ranks=rank_test(whole),
        ambiguous=ambiguity_table(modes),
        by_coordinate=inefficiency_table(whole),
        worst=worst_frames_table(whole),
        settings=settings_table(whole),
        **more.content,
    )


MAX_ENTRIES = 40
LEVELS = (0.05, 0.5, 0.95)


def data_charts(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """The data over the frames, by site and entry, over their posterior predictions, if the result has these."""
    seen, predicted = group_of(tree, "observed_data"), group_of(tree, "posterior_predictive")
    x, made = frame_numbers(tree), {}
    for name, at, label in _entries(seen, leading=1):
        values = np.asarray(seen[name].values[at], float)
        if not np.isfinite(values).any():
            continue
        traces: Traces = []
        if name in predicted:
            ends = np.quantile(_draws(predicted[name], at), LEVELS, axis=0)
            traces += fan(x, ends, ("predicted, central 90 %", "predicted, median"))
        traces.append(line(x, values, "data", OBSERVED, mode="markers", marker_size=5))
        made[label] = _drawn(traces, _unit(tree, name))
    return made


def site_charts(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """Each entry of the state's sites over the frames: its mean on its central 90 % interval, and the truth where known."""
    summary, posterior = group_of(tree, "summary"), group_of(tree, "posterior")
    x, made = frame_numbers(tree), {}
    for name, at, label in _entries(posterior.drop_vars("state", errors="ignore"), leading=3):
        if f"{name}_probability" in summary:
            shares = np.moveaxis(summary[f"{name}_probability"].values, -1, 0)[at]
            values = names_of(tree, f"{name}_value", "summary")
            lines = [line(x, *row) for row in zip(100 * shares, values, cycle(MODES), strict=False)]
            made[label] = _drawn(lines, "probability (%)", yaxis_range=[0, 101])
            continue
        if {f"{name}_mean", f"{name}_quantile"} <= set(summary):
            mean = summary[f"{name}_mean"].values[at]
            low, *_, high = summary[f"{name}_quantile"].transpose("quantile", "frame", ...).values[at]
        else:
            draws = _draws(posterior[name], at)
            mean, (low, high) = draws.mean(axis=0), np.quantile(draws, LEVELS[::2], axis=0)
        made[label] = _drawn(fan(x, (low, mean, high)) + _truth(tree, label, mean), _unit(tree, name))
    return made


def _truth(tree: xr.DataTree, label: str, mean: Array) -> Traces:
    """The truth of an entry that is a coordinate of the flat state: those of bounded sites are on another scale."""
    truth, names = variable(tree, "truth", "state"), names_of(tree, "state_dim")
    if truth is None or label not in names:
        return []
    number = names.index(label)
    same = np.allclose(mean, tree["summary"].dataset["state_mean"].values[:, number])
    return [line(frame_numbers(tree), truth[:, number], "truth", TRUTH)] if same else []


def _draws(data: xr.DataArray, at: Any) -> Array:
    """Draws (draw, frame) of an entry."""
    values = data.transpose("chain", "draw", "frame", ...).values[at]
    return np.asarray(values.reshape(-1, values.shape[2]))


def _entries(data: xr.Dataset, leading: int) -> Iterator[tuple[str, Any, str]]:
    """Name of each variable, the index of an entry after its leading dimensions, and the entry's name; not too many."""
    left = MAX_ENTRIES
    for name, values in data.data_vars.items():
        for at in islice(np.ndindex(values.shape[leading:]), left):
            dims = zip(values.dims[leading:], at, strict=True)
            places = [str(values[dim].values[place]) if dim in values.coords else str(place) for dim, place in dims]
            yield str(name), (..., *at), f"{name}[{', '.join(places)}]" if places else str(name)
            left -= 1


def _drawn(traces: Traces, unit: str, **more: Any) -> go.Figure | None:
    layout: dict[str, Any] = {"yaxis_rangemode": "normal", "showlegend": True}
    return chart(traces, unit, height=300, **layout | more)


def _unit(tree: xr.DataTree, name: str) -> str:
    return str(provenance_table(tree, "units").get(name, ""))
