"""The comparison of runs as one HTML file that opens without a network, and as a CSV table."""

from __future__ import annotations

import csv
from html import escape
from os import PathLike

import xarray as xr

from poseppl.diagnostics import comparison_table
from poseppl.files.atomic_writing import atomic_path
from poseppl.report.compare_charts import comparison_charts, heat_data, variance_data
from poseppl.report.compare_tables import coordinates_table, runs_table, settings_table, winners_strip, winners_table
from poseppl.report.compare_words import findings, wins, words
from poseppl.report.shell import Section, card, page_html

_CARDS = (
    ("ess_per_second", "most ESS a second"),
    ("ess_per_evaluation", "most ESS an evaluation"),
    ("error", "least error"),
)


def write_comparison(tree: xr.DataTree, path: str | PathLike[str]) -> None:
    """Write the page of a comparison.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.
        path: The HTML file, overwritten if it exists; it appears when it is whole.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    page = comparison_html(tree)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="replace")


def write_comparison_table(tree: xr.DataTree, path: str | PathLike[str]) -> None:
    """Write every figure as CSV, one row for each run, frame and degree of freedom; an empty field is no figure.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.
        path: The file, overwritten if it exists; it appears when it is whole.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    rows = comparison_table(tree)
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", errors="replace", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: f"{value:.6g}" if isinstance(value, float) else value for name, value in row.items()})


def comparison_html(tree: xr.DataTree) -> str:
    """Make the page of a comparison.

    Args:
        tree: Of :func:`poseppl.diagnostics.compare`.

    Returns:
        The whole page.
    """
    figures = tree["figures"].dataset
    drawn, heat, variance = comparison_charts(tree), heat_data(tree), variance_data(tree)
    sections = [
        Section("verdicts", "Who wins", _verdicts(tree)),
        Section("where", "Who wins where", _where(tree)),
        Section("inefficiency", "Inefficiency over frames and coordinates", _heat(heat["quantities"])),
        Section("cost", "ESS for its cost", _cost(set(drawn))),
        Section("variance", "Variance against time", _variance(variance)),
        Section("truth", "Error and coverage", _truth(set(drawn))),
        Section("progress", "Frame by frame", _chart("progress", set(drawn))),
        Section("coordinates", "Every coordinate", coordinates_table(tree)),
        Section("runs", "What was run", f'<p class="note">What differs is marked.</p>{settings_table(tree)}'),
    ]
    sizes = figures.sizes
    return page_html(
        f"{sizes['run']} runs compared",
        f"{words(figures['run'].values.tolist())} · {sizes['frame']} frames · {sizes['dof']} coordinates",
        sections,
        cards=_cards(tree),
        data={"charts-data": drawn, "heat-data": heat, "variance-data": variance},
        script="compare.js",
    )


def _cards(tree: xr.DataTree) -> str:
    data = tree["winner"].dataset
    parts = []
    for quantity, label in _CARDS:
        winner = str(data["winner"].sel(quantity=quantity).item())
        counts = ", ".join(f"{name} {count}" for name, count in wins(tree, quantity).items())
        parts.append(card(winner or "–", f"{label} · by coordinate: {counts}" if counts else label))
    return "".join(parts)


def _verdicts(tree: xr.DataTree) -> str:
    items = "".join(f'<li class="{escape(found.severity)}">{escape(found.text)}</li>' for found in findings(tree))
    note = (
        "Means over all frames and coordinates, harmonic means of ESS; bold wins. Time is that of the frames, without "
        "compilation, and a smoother's without that of its filter; an evaluation is one of the likelihood or of its gradient."
    )
    return f'<ul class="verdicts">{items}</ul><h3>The runs</h3><p class="note">{note}</p>{runs_table(tree)}'


def _where(tree: xr.DataTree) -> str:
    note = (
        "A run wins a coordinate where it is ahead of every other by more than the 95 % interval of their ratio over frames, "
        "and the factor is that to the next; else those that may be the best tie. A run whose 90 % intervals cover less than "
        "75 % of the truth is not asked about ESS."
    )
    return f'<p class="note">{note}</p>{winners_strip(tree)}<h3>By how much</h3>{winners_table(tree)}'


def _heat(quantities: list[dict[str, object]]) -> str:
    if not quantities:
        return ""
    options = "".join(f'<option value="{i}">{escape(str(part["label"]))}</option>' for i, part in enumerate(quantities))
    note = (
        "τ draws are worth one independent draw: draws over ESS. For weighted particles it is their number over the effective "
        "number of their weights, the same for every coordinate. Light is good, dark is bad, grey is no figure; τ of 300 and "
        "more are equally dark."
    )
    select = f'<div class="controls"><select id="quantity" aria-label="figure">{options}</select></div>'
    return f'<p class="note">{note}</p>{select}<div id="heat"></div>'


def _cost(drawn: set[str]) -> str:
    note = "Points are harmonic means over the frames; bars hold the middle 90 % of the frames. Right is better."
    return f'<p class="note">{note}</p>{_chart("cost", drawn)}' if "cost" in drawn else ""


def _variance(variance: dict[str, object] | None) -> str:
    if variance is None:
        return ""
    places = variance["places"]
    names = places if isinstance(places, list) else []
    options = "".join(f'<option value="{i}">{escape(name)}</option>' for i, name in enumerate(names))
    note = (
        "Down and left is better; along a dotted line variance times time is the same. Full circles: the variance between runs "
        "of one setting and of different seeds. Open circles: what a single run knows of itself, the mean of 1 / ESS. Bars are "
        "two standard errors. The posterior variance is the median over all runs."
    )
    select = f'<div class="controls"><select id="place" aria-label="coordinate">{options}</select></div>'
    return f'<p class="note">{note}</p>{select}<div id="variance-chart"></div>'


def _truth(drawn: set[str]) -> str:
    if "error" not in drawn and "coverage" not in drawn:
        return ""
    note = "Coverage of the coordinates by central intervals, with two standard errors; on the dotted line it is honest."
    layout = ' class="columns wide"' if {"error", "coverage"} <= drawn else ""
    parts = "".join(f"<div>{_chart(name, drawn)}</div>" for name in ("error", "coverage") if name in drawn)
    return f'<p class="note">{note}</p><div{layout}>{parts}</div>'


def _chart(name: str, drawn: set[str]) -> str:
    return f'<div id="chart-{name}"></div>' if name in drawn else ""
