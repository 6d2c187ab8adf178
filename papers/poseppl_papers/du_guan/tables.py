"""How the page tells the tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.du_guan.mueller import BASINS
from poseppl_papers.du_guan.plan import SYSTEM
from poseppl_papers.experiment import Tables
from poseppl_papers.images.tables import filter_rows, told_errors
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.measured import measured
from poseppl_papers.tables import grouped, markdown, rows_of


def trackers(tables: Tables) -> str:
    """Errors and average sample weights of the filters."""
    rows = []
    for row in filter_rows(tables, "trackers"):
        weight = measured(row, "weight").text(3)
        shown = [row["method"], f"{row['evaluations']:,}", weight, *told_errors(row), f"{row['seconds']:.2g}"]
        rows.append([*shown, str(row["failed"]), str(row["runs"])])
    columns = ("filter", "evaluations", "weight", "error", "relative", "best particle", "s a frame", "frames failed", "runs")
    return markdown(columns, rows)


def sequences(tables: Tables) -> str:
    """Errors on each sequence beside those of a tracker that holds the first pose."""
    held = {row["scene"]: row for row in rows_of(tables, "sequences", method=HOLDING)}
    rows = []
    for row in filter_rows(tables, "sequences"):
        blind = " and ".join(f"{held[row['scene']][name]:.0f}" for name in ("absolute", "relative"))
        shown = [row["scene"], row["method"], *told_errors(row), blind, f"{row['seconds']:.2g}"]
        rows.append([*shown, str(row["failed"]), str(row["runs"])])
    columns = (
        "sequence",
        "filter",
        "error",
        "relative",
        "best particle",
        "first pose held",
        "s a frame",
        "frames failed",
        "runs",
    )
    return markdown(columns, rows)


def scales(tables: Tables) -> str:
    """Errors of sequence 1 over the scales of cues."""
    rows = [
        ["as above" if row["system"] == SYSTEM.name else row["system"].replace("_", " "), *told_errors(row), str(row["runs"])]
        for row in filter_rows(tables, "scales")
    ]
    return markdown(("scales", "error", "relative", "best particle", "runs"), rows)


def noise(tables: Tables) -> str:
    """Errors over c, readings of Eq. 7 and sigmas, on walks that are not among the sequences."""
    groups = grouped(filter_rows(tables, "noise"), lambda row: row["method"])
    rows = []
    for name, own in groups.items():
        errors = [[measured(row, column) for row in own] for column in ("absolute", "relative", "optimistic")]
        mean = sum(each.mean for each in errors[0]) / len(own)
        cells = [", ".join(each.text() for each in column) for column in errors]
        rows.append([*name.split(", "), f"{mean:.0f}", *cells, str(own[0]["runs"])])
    if not rows:
        return ""
    held = rows_of(tables, "noise", method=HOLDING)
    columns = (
        "c",
        "noise by the",
        "sigma of the",
        "mean error",
        "error on each walk",
        "relative",
        "best particle",
        "runs of each",
    )
    blind = " and ".join(", ".join(f"{row[column]:.0f}" for row in held) for column in ("absolute", "relative"))
    return f"{markdown(columns, rows)}\n\nA tracker that holds the first pose has errors of {blind} mm."


def mueller(tables: Tables) -> str:
    """Shares of the basins."""
    rows = [
        [f"{row['temperature']:g}", row["method"], ", ".join(_share(row, name) for name in BASINS)]
        for row in rows_of(tables, "mueller")
    ]
    return markdown(("temperature", "method", "share in A, B, C (%)"), rows)


def _share(row: Mapping[str, Any], basin: str) -> str:
    """A share, with its reach where it is a mean of runs."""
    return f"{row[basin]:.3g}" + (f" +- {row[f'{basin}_reach']:.2g}" if row["runs"] else "")
