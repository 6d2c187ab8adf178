"""The tables of a comparison: the runs, winners by coordinate, every coordinate, forecasts, and settings of the runs."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import cycle
from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.comparison import COSTS
from poseppl.diagnostics.paired_comparison import QUANTITIES, TIE
from poseppl.diagnostics.replicates import evidence_words
from poseppl.diagnostics.selection import evenly
from poseppl.report.page import DASH, Cell, with_error
from poseppl.report.tables import Row, flatten
from poseppl.runs.contents import group_of

COLORS = (
    *("#1f6f8b", "#e4572e", "#6a994e", "#9b5de5", "#dfa32b", "#b5179e", "#4d4d4d", "#00a896"),
    *("#8c5a3c", "#5b8def", "#f08fc0", "#a3b18a", "#7f1d1d", "#14213d", "#c9ada7", "#84cc16"),
)
MAX_LEADS, MAX_SITES = 4, 12
_BY_COORDINATE = ("rhat", "ess", *COSTS, "error", "error_over_sd")
_JUDGED = {"ess_per_second": "ess_per_second_all", "ess_per_evaluation": "ess_per_evaluation_all", "error": "joint_error_all"}


class ShownRun(NamedTuple):
    """How a run is shown: its name, its name with a warning if its posterior is wrong, its colour."""

    name: str
    label: str
    color: str

    @property
    def cell(self) -> Cell:
        """Its name after a dot of its colour."""
        return Cell(self.name, ((self.color, self.name),))


def shown_runs(tree: xr.DataTree) -> list[ShownRun]:
    """The runs of a comparison, in their order."""
    wrong = tree["summary"].dataset["miscalibrated"].values
    names = zip(tree["figures"].dataset["run"].values.tolist(), wrong, cycle(COLORS), strict=False)
    return [ShownRun(name, f"{name} (miscalibrated)" if out else name, color) for name, out, color in names]


def runs_table(tree: xr.DataTree) -> list[Row]:
    """List the runs, one a row; ``bold`` are the columns in which it wins."""
    winner, rows = tree["winner"].dataset["winner"], []
    figures = tree["summary"].dataset.assign(tree["figures"].dataset[["kind", "seconds", "cpu_seconds", "draws"]])
    for index, run in enumerate(shown_runs(tree)):
        row: Row = {str(name): each[index].item() for name, each in figures.data_vars.items() if each.dims == ("run",)}
        row |= {"tau": _figure(figures.isel(run=index), "tau_all", "tau_se_all")}
        row |= {"run": run.cell, "evidence": evidence_words(tree["evidence"].dataset.isel(run=index))}
        row |= {f"cover_{level}": covered(figures, index, level / 100) for level in (50, 90)}
        rows.append(row | {"bold": [_JUDGED[name] for name in QUANTITIES if winner.sel(quantity=name) == run.name]})
    return rows


def coordinates_table(tree: xr.DataTree) -> list[Row]:
    """List every coordinate of every run."""
    summary, rows = tree["summary"].dataset, []
    columns = summary[list(_BY_COORDINATE)].transpose("run", "state_dim")
    for state_dim, label in enumerate(summary["state_dim"].values.tolist()):
        for index, run in enumerate(shown_runs(tree)):
            row: Row = {name: columns[name].values[index, state_dim] for name in _BY_COORDINATE}
            row |= {"tau": _figure(summary.isel(state_dim=state_dim, run=index), "tau", "tau_se")}
            row |= {
                f"cover_{level}": covered(summary.isel(state_dim=state_dim), index, level / 100, "coverage")
                for level in (50, 90)
            }
            rows.append(row | {"state_dim": label, "run": run.cell})
    return rows


def forecast_runs(tree: xr.DataTree) -> Iterator[tuple[str, list[tuple[ShownRun, xr.Dataset]]]]:
    """For each data site of forecasts, the runs that predicted it and their scores by lead; not too many sites."""
    data = group_of(tree, "forecasts")
    for site in data["site"].values[:MAX_SITES].tolist() if data else ():
        yield site, [(run, data.sel(site=site, run=run.name)) for run in shown_runs(tree) if run.name in data["run"].values]


def forecasts_table(tree: xr.DataTree) -> list[Row]:
    """Score and coverage of each site and run at some leads, and coverage at all of them."""
    rows = []
    for site, runs in forecast_runs(tree):
        for lead in evenly(runs[0][1].sizes["lead"], MAX_LEADS):
            for run, scores in runs:
                at = scores.isel(lead=lead)
                row: Row = {"site": site, "lead": at["lead"].item(), "run": run.cell}
                row |= {"crps": _figure(at, "crps", "crps_error")}
                rows.append(row | {name: _figure(100 * at, name, f"{name}_se") for name in ("coverage", "overall")})
    return rows


def winners_table(tree: xr.DataTree) -> list[Row]:
    """List the winner of each coordinate, and its lead over the next."""
    data, cells = tree["winner_by_state_dim"].dataset, {run.name: run.cell for run in shown_runs(tree)}
    return [
        {quantity: _outcome(data.isel(state_dim=state_dim).sel(quantity=quantity), cells) for quantity in QUANTITIES}
        | {"state_dim": label, "decided": bool((data["winner"].isel(state_dim=state_dim) != "").any())}
        for state_dim, label in enumerate(data["state_dim"].values.tolist())
    ]


def settings_table(tree: xr.DataTree) -> dict[str, list[str]]:
    """List the provenance of all runs side by side, by setting."""
    columns = {name: flatten(given) for name, given in json.loads(tree.attrs["provenance"]).items()}
    labels = dict.fromkeys(label for column in columns.values() for label in column)
    return {label: [column.get(label, DASH) for column in columns.values()] for label in labels}


def _outcome(row: xr.Dataset, cells: dict[str, Cell]) -> Cell:
    winner = str(row["winner"].item())
    if not winner:
        return Cell(DASH)
    if winner == TIE:
        return Cell("tie", tuple(cells[name].dots[0] for name in row["run"].values[row["not_worse"].values].tolist()))
    others = row["ratio"].drop_sel(run=winner).values
    factor = f" {1 / np.nanmax(others):.2g} ×" if np.isfinite(others).any() else ""
    return Cell(f"{winner}{factor}", cells[winner].dots)


def covered(summary: xr.Dataset, index: int, level: float, name: str = "coverage_all") -> str:
    """Coverage of a run and its standard error, in per cent."""
    error = name.replace("coverage", "coverage_se")
    return _figure(100 * summary[[name, error]].isel(run=index).sel(level=level, method="nearest"), name, error, 0)


def _figure(at: xr.Dataset, name: str, error: str, digits: int | None = None) -> str:
    """A figure of a summary and its standard error."""
    return with_error(float(at[name]), float(at[error]), digits)
