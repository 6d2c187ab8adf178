"""Modes of single poses that a search finds by where it starts, and what is claimed of scaled covariances (section 4.2).

The table is made by the study ``studies.modes_found``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from poseppl_papers.experiment import Claim
from poseppl_papers.measured import MATTERS, mean_interval
from poseppl_papers.tables import Table, markdown

Tables = Mapping[str, Table]
Rows = list[dict[str, Any]]
_STARTS = (12, 48, 192)
_SCALED, _NOISE = "covariance scaled", ("dynamic noise", "multiple hypotheses")


def modes_found(tables: Tables) -> str:
    """Shares of modes by method and number of starts, and modes an evaluation; empty without the table."""
    if "modes_found" not in tables:
        return ""
    rows = tables["modes_found"].records()
    names = dict.fromkeys(row["method"] for row in rows)
    cells = {name: [_cell(rows, name, count) for count in _STARTS] for name in names}
    (scaled, scaled_name), (noise, noise_name) = _best(rows, _SCALED), max(_best(rows, kind) for kind in _NOISE)
    jumps, prior = (_rate(rows, name) for name in ("kinematic jumps", "draws of the prior"))
    sentence = (
        f"With {_STARTS[-1]} starts the best of scaled covariances ({scaled_name}) finds {scaled:.1f} modes in 1,000 "
        f"evaluations, the best of noise ({noise_name}) {noise:.1f}, kinematic jumps {jumps:.1f}, and draws of the prior "
        f"{prior:.1f}."
    )
    header = ("starts drawn from", *(f"{count} starts" for count in _STARTS))
    return f"{markdown(header, [[name, *cells[name]] for name in names])}\n\n{sentence}"


def modes_claim(tables: Tables) -> Claim:
    """Whether scaled covariances find more modes an evaluation than inflated noise, the best setting of each."""
    rows = tables["modes_found"].records()
    scaled, (noise, noise_name) = _best(rows, _SCALED)[1], max(_best(rows, kind) for kind in _NOISE)
    own, theirs = _rates(rows, scaled), _rates(rows, noise_name)
    more = mean_interval(np.subtract(own, theirs))
    return Claim(
        "Section 6: covariance scaled sampling finds more modes of a pose an evaluation than inflated dynamical noise",
        "significantly more effective",
        f"{np.mean(own):.1f} against {np.mean(theirs):.1f} in 1,000 evaluations, {more.text('.1f')} more, {len(own)} poses",
        more.above(MATTERS * noise),
        f"by more than a tenth; {scaled} against {noise_name}, {_STARTS[-1]} starts; 95 % interval over poses",
    )


def _of(rows: Rows, name: str, count: int) -> Rows:
    return [row for row in rows if row["method"] == name and row["starts"] == count]


def _cell(rows: Rows, name: str, count: int) -> str:
    """Percent of the modes and of their mass, and evaluations; means over poses."""
    mine = _of(rows, name, count)
    shares = [
        sum(100 * row[key] / (row["of"] if key == "modes" else 1) for row in mine) / len(mine) for key in ("modes", "mass")
    ]
    return f"{shares[0]:.0f} %, {shares[1]:.0f} % ({sum(row['evaluations'] for row in mine) / len(mine):,.0f})"


def _best(rows: Rows, kind: str) -> tuple[float, str]:
    """The rate of the best setting of a kind of starts, and its name."""
    names = dict.fromkeys(row["method"] for row in rows)
    return max((_rate(rows, name), name) for name in names if name.startswith(kind))


def _rate(rows: Rows, name: str) -> float:
    """Modes beside the first in 1,000 evaluations, at the most starts; mean over poses."""
    return float(np.mean(_rates(rows, name)))


def _rates(rows: Rows, name: str) -> list[float]:
    """The same of each pose."""
    return [1000 * (row["modes"] - 1) / row["evaluations"] for row in _of(rows, name, _STARTS[-1])]
