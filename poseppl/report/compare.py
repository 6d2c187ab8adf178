"""The comparison of runs as one HTML file that opens without a network, and as a CSV table."""

from __future__ import annotations

from collections.abc import Iterator

import xarray as xr

from poseppl.diagnostics import comparison_table
from poseppl.diagnostics.paired_comparison import QUANTITIES
from poseppl.diagnostics.verdicts.comparison import findings, wins, words
from poseppl.errors import FilePath
from poseppl.files.atomic_writing import write_atomically, write_rows
from poseppl.report.compare_charts import comparison_charts, forecast_charts
from poseppl.report.compare_tables import (
    coordinates_table,
    forecasts_table,
    foretold,
    runs_table,
    settings_table,
    winners_table,
)
from poseppl.report.page import page_html
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
        num_shown=len(list(foretold(tree))),
        settings=settings_table(tree),
    )


def _cards(tree: xr.DataTree, quantity: str) -> Iterator[tuple[str, str]]:
    """The winner of a quantity, and how many coordinates each run wins; nothing where fewer than two runs have it."""
    winner = str(tree["winner"].dataset["winner"].sel(quantity=quantity).item())
    counts = ", ".join(f"{name} {count}" for name, count in wins(tree, quantity).items())
    if winner:
        yield winner, f"{QUANTITIES[quantity]} · by coordinate: {counts}" if counts else QUANTITIES[quantity]
