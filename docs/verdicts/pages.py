"""Which parts of which pages are made from tables.

In a page such a part stands between two marks, ``<!-- from tables: NAME -->`` and ``<!-- end -->``. All numbers and verdicts in
it come from docs/tables and docs/choo-fleet-2001, through the functions named here.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from poseppl.experiments.provenance import read_folder
from poseppl.experiments.tables import Table
from verdicts import choo_fleet, image_claims, image_tables, modes, predictions, sampling, walks

Tables = Mapping[str, Table]
DOCS = Path(__file__).resolve().parents[1]
FOLDERS = (DOCS / "tables", DOCS / "choo-fleet-2001")
MARKED = re.compile(r"(<!-- from tables: ([\w-]+) -->\n\n)(.*?)(\n\n<!-- end -->)", re.DOTALL)

SECTIONS: Mapping[str, Mapping[str, Callable[[Tables], str]]] = {
    "likelihoods.md": {
        "peursum": image_tables.peursum,
        "exponents": image_tables.exponents,
        "darby": image_tables.darby,
        "du-guan": image_tables.du_guan,
        "image-claims": image_claims.claims,
    },
    "measurements.md": {
        "random-walks": walks.random_walks,
        "filters": sampling.filters,
        "mueller": sampling.mueller,
        "modes-found": modes.modes_found,
        "dimensionality": sampling.dimensionality,
        "mixtures": sampling.mixtures,
        "trajectory": sampling.trajectory,
        "speed-ups": choo_fleet.speed_ups,
        "contest": choo_fleet.contest,
    },
    "verdicts.md": {"predictive-checks": predictions.checks},
}


def read_tables() -> dict[str, Table]:
    """All committed tables by name."""
    return {name: kept.table for folder in FOLDERS for name, kept in read_folder(folder).items()}


def made(text: str, page: str, tables: Tables) -> str:
    """The text of a page with its marked parts made anew."""
    return MARKED.sub(lambda found: found[1] + SECTIONS[page][found[2]](tables) + found[4], text)
