"""An experiment: parts with jobs, tables and figures, and the claims that its tables decide; every folder here makes one.

    EXPERIMENT = Experiment(
        name="author-2001",
        title="Author 2001, run again",
        setting="One camera.",
        departures="- Resampling is systematic.",
        full=Scale(runs=50),
        quick=Scale(runs=2),
        parts={"errors": Part("errors over time", plan, tabulate, draw, runs=lambda scale: scale.runs)},
        claims=claims,
        pictures={"errors.png": "Errors (Fig. 3)"},
        shown=("errors",),
    )

:func:`poseppl_papers.reproduction.reproduce` runs it, :func:`poseppl_papers.page.page_of` tells what was found, and a
row in :mod:`poseppl_papers.catalogue` puts it on the command line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from poseppl.report.picture import Picture
from poseppl_papers.recordings import Recording
from poseppl_papers.tables import Table

Tables = Mapping[str, Table]
Results = Mapping[str, Mapping[str, Any]]
"""Results of jobs, by their keys."""
Jobs = Mapping[str, Sequence[Any]]
"""Jobs of a part by the name of their task."""
Section = Callable[[Tables], str]
"""A section of a page, in Markdown; empty where the tables tell nothing of it."""
Pictures = Mapping[str, Picture]
"""Figures by the name of their file."""

UNPUBLISHED = "not in the paper"
"""Theirs, of a claim on a method of our own."""
HOLDS, FAILS, UNDECIDED = "holds", "does not hold", "undecided"


class Claim(NamedTuple):
    """A published claim.

    Attributes:
        what: The claim.
        theirs: Their figure.
        ours: Ours, with its error.
        verdict: :data:`HOLDS`, :data:`FAILS`, :data:`UNDECIDED`, or why there is none.
        why: In a sentence.
    """

    what: str
    theirs: str
    ours: str
    verdict: str
    why: str


Decide = Callable[[Tables], Claim | Iterable[Claim]]
"""Function that decides claims from tables."""


class Task(NamedTuple):
    """Jobs of one function.

    Attributes:
        function: `job -> {name: array}`, at the top level of a module.
        jobs: The jobs.
    """

    function: Callable[[Any], Mapping[str, Any]]
    jobs: Sequence[Any]


def no_pictures(tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """Draw nothing."""
    return {}


class Part(NamedTuple):
    """A part of an experiment, which can be run alone.

    Attributes:
        about: Quantity that it measures, in a few words.
        plan: The tasks by name, from the scale and the recordings; they are run one after the other. Parts may share jobs,
            which are computed once.
        tabulate: The tables, from the jobs by task and their results.
        draw: The figures, from the tables of this call, the jobs and their results.
        runs: How many runs the tables sum up, from the scale.
        all_recordings: Whether it sees all recordings; otherwise the first.
        seen: Data that it uses in place of recordings, if it needs none.
    """

    about: str
    plan: Callable[[Any, Sequence[Recording]], Mapping[str, Task]]
    tabulate: Callable[[Jobs, Results], Sequence[Table]]
    draw: Callable[[Tables, Jobs, Results], Pictures] = no_pictures
    runs: Callable[[Any], int] = lambda scale: int(scale.runs)
    all_recordings: bool = False
    seen: str = ""


class Experiment(NamedTuple):
    """A published experiment.

    Attributes:
        name: As the command line has it, such as "choo-fleet-2001".
        title: Title of its page.
        setting: Common setting of all parts, a paragraph.
        departures: Departures from the paper, a list in Markdown.
        full: Scale of the paper: how much is computed, as the parts' plans take it.
        quick: The same in minutes.
        parts: By name.
        claims: The claims that the tables at hand decide.
        sections: Further sections of the page by title, in Markdown; one that is empty is left out.
        pictures: Titles of the figures by the name of their file.
        shown: Names of the tables that the page shows whole.
    """

    name: str
    title: str
    setting: str
    departures: str
    full: Any
    quick: Any
    parts: Mapping[str, Part]
    claims: Callable[[Tables], Sequence[Claim]]
    sections: Mapping[str, Section] = {}
    pictures: Mapping[str, str] = {}
    shown: Sequence[str] = ()


def verdict_of(holds: bool, fails: bool | None = None) -> str:
    """Word a verdict: undecided if a claim neither holds nor fails; without `fails`, a claim that does not hold fails."""
    return HOLDS if holds else FAILS if fails is None or fails else UNDECIDED


def all_of(verdicts: Iterable[str]) -> str:
    """The verdict on a claim that has several parts: it holds if all do, and fails if one fails."""
    found = list(verdicts)
    return verdict_of(all(each == HOLDS for each in found), FAILS in found)


def on_one_recording(verdict: str) -> str:
    """A verdict whose interval is over the runs on a single recording, which says nothing of others."""
    return f"{verdict} on one recording"


def claims_by_table(claims: Mapping[str, Sequence[Decide]]) -> Callable[[Tables], list[Claim]]:
    """Claims by the table that decides them; those whose table is not at hand are left out."""

    def decided(tables: Tables) -> list[Claim]:
        found = [claim(tables) for name, own in claims.items() if name in tables for claim in own]
        return [each for one in found for each in ([one] if isinstance(one, Claim) else one)]

    return decided
