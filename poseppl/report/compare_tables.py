"""The tables of a comparison: the runs, who wins in which coordinate, every coordinate, and what was run."""

from __future__ import annotations

import json
from itertools import cycle, islice
from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.evidence import Evidence, evidence_words
from poseppl.diagnostics.paired_comparison import QUANTITIES, TIE
from poseppl.report.page import DASH, Cell, Rows
from poseppl.report.tables import flatten

COVERED = ("50 % intervals cover, %", "90 % intervals cover, %")
COLORS = (
    *("#1f6f8b", "#e4572e", "#6a994e", "#9b5de5", "#dfa32b", "#b5179e", "#4d4d4d", "#00a896"),
    *("#8c5a3c", "#5b8def", "#f08fc0", "#a3b18a", "#7f1d1d", "#14213d", "#c9ada7", "#84cc16"),
)
TITLES = {"ess_per_second": "ESS a second", "ess_per_evaluation": "ESS an evaluation", "error": "error against the truth"}
_JUDGED = {"ess_per_second_all": "ess_per_second", "ess_per_evaluation_all": "ess_per_evaluation", "joint_error_all": "error"}
_COLUMNS = (
    ("seconds a frame", "seconds", ""),
    ("draws a frame", "draws", "{:,.0f}"),
    ("τ, median", "tau_median_all", ""),
    ("τ, mean", "tau_all", ""),
    ("ESS", "ess_all", ""),
    ("ESS a second", "ess_per_second_all", ""),
    ("ESS an evaluation", "ess_per_evaluation_all", ""),
    ("rejected", "rejection_all", "{:.0%}"),
    ("largest R-hat", "rhat_all", "{:.2f}"),
    ("joint error, mm", "joint_error_all", "{:.0f}"),
    ("relative to the root, mm", "joint_error_relative_all", "{:.0f}"),
)
_BY_COORDINATE = (
    ("τ, mean", "tau", ""),
    ("ESS", "ess", ""),
    ("ESS a second", "ess_per_second", ""),
    ("ESS an evaluation", "ess_per_evaluation", ""),
    ("largest R-hat", "rhat", "{:.2f}"),
    ("error, mm or radians", "error", ""),
    ("error / sd, median", "error_over_sd", ""),
)


def run_colors(count: int) -> list[str]:
    """Colours of runs."""
    return list(islice(cycle(COLORS), count))


def run_names(tree: xr.DataTree) -> list[str]:
    """Names of the runs, text."""
    return [str(name) for name in tree["figures"].dataset["run"].values]


def run_labels(tree: xr.DataTree) -> list[str]:
    """Names of the runs where ESS is shown, with a warning on those whose posterior is wrong."""
    out = tree["summary"].dataset["miscalibrated"].values
    return [f"{name} (miscalibrated)" if wrong else name for name, wrong in zip(run_names(tree), out, strict=True)]


def shown(value: Any, form: str = "") -> str:
    """A figure in words, a dash where there is none; to two or three significant digits without a form."""
    if not np.isfinite(value):
        return DASH
    if form:
        return form.format(value)
    if value != 0 and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
    return f"{float(f'{value:.3g}'):,.0f}" if abs(value) >= 100 else f"{value:.2g}"


def runs_table(tree: xr.DataTree) -> Rows:
    """List the runs, one a row; what wins is bold."""
    figures, summary, winner = (tree[name].dataset for name in ("figures", "summary", "winner"))
    rows = []
    for index, (name, dot) in enumerate(_dots(tree).items()):
        cells: list[Any] = [Cell(name, (dot,)), figures["kind"].values[index]]
        for _, column, form in _COLUMNS:
            value = (figures if column in figures else summary)[column].values[index]
            wins = column in _JUDGED and str(winner["winner"].sel(quantity=_JUDGED[column]).item()) == name
            cells.append(Cell(shown(value, form), element="b" if wins else ""))
        rows.append((*cells, *(covered(summary, index, level) for level in (0.5, 0.9)), log_evidence(tree, index)))
    return Rows(("run", "kind", *(title for title, _, _ in _COLUMNS), *COVERED, "log evidence"), rows)


def winners_table(tree: xr.DataTree) -> Rows:
    """List who wins in which coordinate, and how far ahead of the next."""
    data, dots = tree["winner_by_dof"].dataset, _dots(tree)
    rows = [
        (label, *(_outcome(data.sel(quantity=quantity).isel(dof=dof), dots) for quantity in QUANTITIES))
        for dof, label in enumerate(data["dof"].values.tolist())
    ]
    return Rows(("coordinate", *(TITLES[quantity] for quantity in QUANTITIES)), rows)


def winners_strip(tree: xr.DataTree) -> dict[str, Any]:
    """Colours of who wins where: ``rows`` of (title, pairs of label and colour), ``foot`` and ``legend``."""
    data, dots = tree["winner_by_dof"].dataset, _dots(tree)
    colors = {name: color for name, (color, _) in dots.items()} | {TIE: "#dfe3e8", "": "white"}
    labels, rows = data["dof"].values.tolist(), []
    for quantity in QUANTITIES:
        found = [str(winner) for winner in data["winner"].sel(quantity=quantity).values]
        cells = [(f"{label}: {winner or DASH}", colors[winner]) for label, winner in zip(labels, found, strict=True)]
        rows.append((TITLES[quantity], cells))
    legend = [Cell(name, (dot,)) for name, dot in dots.items() if (data["winner"].values == name).any()]
    return {"rows": rows, "foot": labels, "legend": [*legend, Cell("tie", ((colors[TIE], "tie"),))]}


def coordinates_table(tree: xr.DataTree) -> Rows:
    """List every coordinate of every run."""
    summary, dots = tree["summary"].dataset, _dots(tree)
    rows = []
    for dof, label in enumerate(summary["dof"].values.tolist()):
        for index, (name, dot) in enumerate(dots.items()):
            cells = [shown(summary[column].values[index, dof], form) for _, column, form in _BY_COORDINATE]
            shares = [covered(summary.isel(dof=dof), index, level, "coverage") for level in (0.5, 0.9)]
            rows.append((label, Cell(name, (dot,)), *cells, *shares))
    return Rows(("coordinate", "run", *(title for title, _, _ in _BY_COORDINATE), *COVERED), rows)


def settings_table(tree: xr.DataTree) -> Rows:
    """List the provenance of all runs side by side; what differs is marked."""
    columns = {
        name: {label: str(value) for key, part in given.items() for label, value in flatten(key.replace("_", " "), part)}
        for name, given in json.loads(tree.attrs["provenance"]).items()
    }
    rows = []
    for label in dict.fromkeys(label for column in columns.values() for label in column):
        cells = [column.get(label, DASH) for column in columns.values()]
        rows.append((label, *(Cell(cell, element="mark" if len(set(cells)) > 1 else "") for cell in cells)))
    return Rows(("", *columns), rows)


def _dots(tree: xr.DataTree) -> dict[str, tuple[str, str]]:
    """Colour and name of each run, by its name."""
    names = tree["figures"].dataset["run"].values.tolist()
    return {name: (color, name) for name, color in zip(names, run_colors(len(names)), strict=True)}


def _outcome(row: xr.Dataset, dots: dict[str, tuple[str, str]]) -> Cell:
    winner = str(row["winner"].item())
    if not winner:
        return Cell(DASH)
    if winner == TIE:
        return Cell("tie", tuple(dots[name] for name in row["run"].values[row["not_worse"].values].tolist()))
    others = row["ratio"].drop_sel(run=winner).values
    factor = f" {1 / np.nanmax(others):.2g} ×" if np.isfinite(others).any() else ""
    return Cell(f"{winner}{factor}", (dots[winner],))


def log_evidence(tree: xr.DataTree, index: int) -> str:
    """Log-evidence of a run and its standard error, a question mark where that is not known."""
    data = tree["evidence"].dataset.isel(run=index)
    return evidence_words(Evidence(*(data[name].item() for name in Evidence._fields)))


def covered(summary: xr.Dataset, index: int, level: float, name: str = "coverage_all") -> str:
    """Coverage of a run and its standard error, in per cent."""
    at = summary.isel(run=index).sel(level=level, method="nearest")
    share, error = (100 * float(at[column]) for column in (name, name.replace("coverage", "coverage_se")))
    return f"{share:.0f} ± {error:.0f}" if np.isfinite(share) else DASH
