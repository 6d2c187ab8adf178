"""All experiments by the names that the command line has for them.

Nothing heavy is imported before one is wanted.

>>> find_experiment("choo-fleet-2001").title
'Choo and Fleet 2001, run again'
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from poseppl.declarations import declared

if TYPE_CHECKING:
    from poseppl_papers.experiment import Experiment

EXPERIMENTS: Mapping[str, str] = {
    "choo-fleet-2001": "poseppl_papers.choo_fleet",
    "sminchisescu-triggs-2001": "poseppl_papers.sminchisescu_triggs",
    "du-guan-2006": "poseppl_papers.du_guan",
    "darby-2008": "poseppl_papers.darby",
    "peursum-2010": "poseppl_papers.peursum",
    "bodytrack": "poseppl_papers.bodytrack",
}
"""Packages, each with its `EXPERIMENT`."""


def parts_of(name: str) -> dict[str, str]:
    """The parts of an experiment, and what each measures; nothing is imported for that.

    >>> parts_of("bodytrack")["estimates"]
    'what annealed filters find in the first frame'
    """
    return {part: row.about for part, row in declared(EXPERIMENTS[name], "EXPERIMENT").parts.items()}


def find_experiment(name: str) -> Experiment:
    """The experiment of a name.

    Raises:
        KeyError: There is none.
    """
    found: Experiment = import_module(EXPERIMENTS[name]).EXPERIMENT
    return found
