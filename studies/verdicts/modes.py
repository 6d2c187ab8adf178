"""Modes that a search finds by where it starts, and what is claimed of scaled covariances, for docs/validation/filters.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
_STARTS = (12, 48, 192)
_SCALED, _NOISE = "covariance scaled", ("dynamic noise", "multiple hypotheses")
_HOLDS = {True: "holds", False: "does not hold"}


def modes_found(tables: Tables) -> str:
    """Shares of modes by method and number of starts, and the claim that scaled covariances find more than noise."""
    rows = tables["modes_found"].records()
    names = dict.fromkeys(row["method"] for row in rows)
    cells = {name: [_cell(rows, name, count) for count in _STARTS] for name in names}
    best = {kind: max((_rate(rows, name), name) for name in names if name.startswith(kind)) for kind in (_SCALED, *_NOISE)}
    (scaled, scaled_name), (noise, noise_name) = best[_SCALED], max(best[kind] for kind in _NOISE)
    told = (
        f"Sampling by scaled covariances finds more modes an evaluation than inflated noise: {_HOLDS[scaled > noise]} here. "
        f"With {_STARTS[-1]} starts the best of it ({scaled_name}) finds {scaled:.1f} modes in 1,000 evaluations, the best of "
        f"noise ({noise_name}) {noise:.1f}, kinematic jumps {_rate(rows, 'kinematic jumps'):.1f}, and draws of the prior "
        f"{_rate(rows, 'draws of the prior'):.1f}."
    )
    header = ("starts drawn from", *(f"{count} starts" for count in _STARTS))
    return f"{markdown(header, [[name, *cells[name]] for name in names])}\n\n{told}"


def _of(rows: list[dict[str, Any]], name: str, count: int) -> list[dict[str, Any]]:
    return [row for row in rows if row["method"] == name and row["starts"] == count]


def _cell(rows: list[dict[str, Any]], name: str, count: int) -> str:
    """Percent of the modes and of their mass, and evaluations; means over poses."""
    mine = _of(rows, name, count)
    shares = [
        sum(100 * row[key] / (row["of"] if key == "modes" else 1) for row in mine) / len(mine) for key in ("modes", "mass")
    ]
    return f"{shares[0]:.0f} %, {shares[1]:.0f} % ({sum(row['evaluations'] for row in mine) / len(mine):,.0f})"


def _rate(rows: list[dict[str, Any]], name: str) -> float:
    """Modes beside the first in 1,000 evaluations, at the most starts."""
    mine = _of(rows, name, _STARTS[-1])
    return 1000 * sum(row["modes"] - 1 for row in mine) / sum(row["evaluations"] for row in mine)
