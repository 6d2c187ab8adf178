"""Forecasts of several runs side by side: a table of some leads, and the score over all of them, one chart a data site."""

from __future__ import annotations

import numpy as np
import xarray as xr
from plotly import graph_objects as go

from poseppl.diagnostics.selection import evenly
from poseppl.report.chart import bars, chart, line
from poseppl.report.compare_tables import ShownRun, shown_runs
from poseppl.report.page import DASH, Cell
from poseppl.report.tables import Row
from poseppl.runs.contents import group_of

MAX_LEADS, MAX_SITES = 4, 12


def forecast_charts(tree: xr.DataTree) -> dict[str, go.Figure | None]:
    """The score over the frames ahead, with bars of two standard errors, by data site."""
    data = _foretold(tree)
    leads = data["lead"].values if data else np.zeros(0)
    made: dict[str, go.Figure | None] = {}
    for site in data["site"].values.tolist() if data else ():
        here = data.sel(site=site)
        traces = [
            line(
                leads,
                here["crps"].sel(run=run.name).values,
                run.name,
                run.color,
                mode="lines+markers",
                error_y=bars(2 * here["crps_error"].sel(run=run.name).values, color=run.color),
            )
            for run in _runs(tree, data)
        ]
        made[str(site)] = chart(traces, f"CRPS of {site}", xlabel="frames ahead", height=300, showlegend=True)
    return made


def forecasts_table(tree: xr.DataTree) -> list[Row]:
    """Score and coverage of each site and run at some leads, and coverage at all of them."""
    data, rows = _foretold(tree), []
    for site in data["site"].values.tolist() if data else ():
        for lead in data["lead"].values[evenly(data.sizes["lead"], MAX_LEADS)].tolist():
            for run in _runs(tree, data):
                at = data.sel(site=site, lead=lead, run=run.name)
                row: Row = {"site": site, "lead": lead, "run": Cell(run.name, (run.dot,)), "crps": _told(at, "crps", "_error")}
                rows.append(row | {name: _told(100 * at, name, "_se") for name in ("coverage", "overall")})
    return rows


def _foretold(tree: xr.DataTree) -> xr.Dataset:
    data = group_of(tree, "forecasts")
    return data.isel(site=slice(MAX_SITES)) if data else data


def _runs(tree: xr.DataTree, data: xr.Dataset) -> list[ShownRun]:
    return [run for run in shown_runs(tree) if run.name in data["run"].values]


def _told(at: xr.Dataset, name: str, ending: str) -> str:
    """A figure and its standard error, to two digits of this."""
    value, spread = float(at[name]), float(at[name + ending])
    if not np.isfinite(value):
        return DASH
    digits = max(0, 1 - int(np.floor(np.log10(spread)))) if np.isfinite(spread) and spread > 0 else 2
    return f"{value:.{digits}f} ± {spread:.{digits}f}"
