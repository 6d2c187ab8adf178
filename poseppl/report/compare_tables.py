"""The tables of a comparison, as HTML: the runs, who wins in which coordinate, every coordinate, and what was run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from html import escape
from itertools import cycle, islice
from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.contest import QUANTITIES, TIE
from poseppl.diagnostics.evidence import Evidence, evidence_words
from poseppl.report.tables import Raw, flatten, table

DASH = "–"
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


def shown(value: Any, form: str = "") -> str:
    """A figure in words, a dash where there is none; to two or three significant digits without a form."""
    if not np.isfinite(value):
        return DASH
    if form:
        return form.format(value)
    if value != 0 and not 1e-3 <= abs(value) < 1e9:
        return f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
    return f"{float(f'{value:.3g}'):,.0f}" if abs(value) >= 100 else f"{value:.2g}"


def runs_table(tree: xr.DataTree) -> str:
    """Lay out the runs, one a row; what wins is bold."""
    figures, summary, winner = (tree[name].dataset for name in ("figures", "summary", "winner"))
    chips = _chips(tree)
    rows: list[list[object]] = []
    for index, name in enumerate(figures["run"].values.tolist()):
        cells: list[object] = [chips[name], figures["kind"].values[index]]
        for _, column, form in _COLUMNS:
            value = (figures if column in figures else summary)[column].values[index]
            wins = column in _JUDGED and str(winner["winner"].sel(quantity=_JUDGED[column]).item()) == name
            cells.append(Raw(f"<b>{shown(value, form)}</b>") if wins else shown(value, form))
        cells += [*(covered(summary, index, level) for level in (0.5, 0.9)), log_evidence(tree, index)]
        rows.append(cells)
    return _figures(("run", "kind", *(title for title, _, _ in _COLUMNS), *COVERED, "log evidence"), rows)


def winners_table(tree: xr.DataTree) -> str:
    """Lay out who wins in which coordinate, and how far ahead of the next."""
    data, chips = tree["winner_by_dof"].dataset, _chips(tree)
    rows = [
        (label, *(_outcome(data.sel(quantity=quantity).isel(dof=dof), chips) for quantity in QUANTITIES))
        for dof, label in enumerate(data["dof"].values.tolist())
    ]
    return table(("coordinate", *(TITLES[quantity] for quantity in QUANTITIES)), rows)


def winners_strip(tree: xr.DataTree) -> str:
    """Lay out who wins where as coloured cells, one row a quantity, one column a coordinate."""
    data = tree["winner_by_dof"].dataset
    names = tree["figures"].dataset["run"].values.tolist()
    colors = dict(zip(names, run_colors(len(names)), strict=True)) | {TIE: "#dfe3e8"}
    labels = data["dof"].values.tolist()
    rows = []
    for quantity in QUANTITIES:
        found = [str(winner) for winner in data["winner"].sel(quantity=quantity).values]
        cells = (_square(f"{label}: {winner or DASH}", colors.get(winner)) for label, winner in zip(labels, found, strict=True))
        rows.append(f"<tr><th>{TITLES[quantity]}</th>{''.join(cells)}</tr>")
    foot = "".join(f"<td><span>{escape(label)}</span></td>" for label in labels)
    winners = [name for name in names if (data["winner"].values == name).any()]
    chips = _chips(tree)
    legend = "".join(f"<span>{chips[name]}</span>" for name in winners)
    grey = f'<span><span class="chip" style="background:{colors[TIE]}"></span>tie</span>'
    return (
        f'<div class="legend">{legend}{grey}<span>empty: no contest</span></div><div class="scroll"><table class="strip">'
        f"{''.join(rows)}<tr><th></th>{foot}</tr></table></div>"
    )


def coordinates_table(tree: xr.DataTree) -> str:
    """Lay out every coordinate of every run."""
    summary, chips = tree["summary"].dataset, _chips(tree)
    rows = []
    for dof, label in enumerate(summary["dof"].values.tolist()):
        for index, name in enumerate(summary["run"].values.tolist()):
            cells = [shown(summary[column].values[index, dof], form) for _, column, form in _BY_COORDINATE]
            shares = [covered(summary.isel(dof=dof), index, level, "coverage") for level in (0.5, 0.9)]
            rows.append((label, chips[name], *cells, *shares))
    return _figures(("coordinate", "run", *(title for title, _, _ in _BY_COORDINATE), *COVERED), rows)


def settings_table(tree: xr.DataTree) -> str:
    """Lay out the provenance of all runs side by side; what differs is marked."""
    known = json.loads(tree.attrs["provenance"])
    columns = {
        name: {label: str(value) for key, part in given.items() for label, value in flatten(key.replace("_", " "), part)}
        for name, given in known.items()
    }
    labels = list(dict.fromkeys(label for column in columns.values() for label in column))
    rows = []
    for label in labels:
        cells = [column.get(label, DASH) for column in columns.values()]
        differs = len(set(cells)) > 1
        rows.append((label, *(Raw(f"<mark>{escape(cell)}</mark>") if differs else cell for cell in cells)))
    return table(("", *columns), rows)


def _square(title: str, color: str | None) -> str:
    return f'<td title="{escape(title)}" style="background:{color or "white"}"></td>'


def _figures(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table whose cells are not broken."""
    return f'<div class="figures">{table(head, rows)}</div>'


def _chips(tree: xr.DataTree) -> dict[str, Raw]:
    names = tree["figures"].dataset["run"].values.tolist()
    pairs = zip(names, run_colors(len(names)), strict=True)
    return {name: Raw(f'<span class="chip" style="background:{color}"></span>{escape(name)}') for name, color in pairs}


def _outcome(row: xr.Dataset, chips: dict[str, Raw]) -> Raw:
    winner = str(row["winner"].item())
    if not winner:
        return Raw(DASH)
    names = row["run"].values[row["leads"].values].tolist()
    if winner == TIE:
        dots = "".join(f'<span title="{escape(name)}">{_dot(chips[name])}</span>' for name in names)
        return Raw(f'<span class="tie">{dots} tie</span>')
    others = row["ratio"].drop_sel(run=winner).values
    factor = f" {1 / np.nanmax(others):.2g} ×" if np.isfinite(others).any() else ""
    return Raw(f"{chips[winner]}{factor}")


def _dot(chip: Raw) -> str:
    return chip[: chip.index("</span>") + len("</span>")]


def log_evidence(tree: xr.DataTree, index: int) -> str:
    """Log-evidence of a run and its standard error, a question mark where that is not known."""
    data = tree["evidence"].dataset.isel(run=index)
    return evidence_words(Evidence(*(data[name].item() for name in Evidence._fields)))


def covered(summary: xr.Dataset, index: int, level: float, name: str = "coverage_all") -> str:
    """Coverage of a run and its standard error, in per cent."""
    at = summary.isel(run=index).sel(level=level, method="nearest")
    share, error = (100 * float(at[column]) for column in (name, name.replace("coverage", "coverage_se")))
    return f"{share:.0f} ± {error:.0f}" if np.isfinite(share) else DASH
