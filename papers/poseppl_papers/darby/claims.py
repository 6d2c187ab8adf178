"""The published claims, theirs and ours, whether each holds, and how the page tells the tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from poseppl_papers.darby.plan import AGREEING, KNOWN, MODIFIED, SITTING, STANDARD, TEMPERATURE, UNKNOWN, WALKING, WALKING_ALONE
from poseppl_papers.experiment import Claim, Jobs, Results, Tables, claims_by_table, on_one_recording, verdict_of
from poseppl_papers.images.systems import System
from poseppl_papers.images.tables import ABOUT, COLUMNS, filter_row, filter_rows, told_errors
from poseppl_papers.images.tracking import HOLDING
from poseppl_papers.measured import MATTERS, Interval, difference, find, mean_interval
from poseppl_papers.tables import Table, grouped, markdown

_THREE_CAMERAS = 41.0
"""Optimistic error (mm) of the standard filter with three cameras, as the paper quotes Balan (2005)."""


def _walks(tables: Tables, name: str, system: System, figure: str) -> dict[str, tuple[str, float]]:
    """By walk: the method of the most evaluations, and a figure."""
    rows = sorted(filter_rows(tables, name, system=system.name), key=lambda row: int(row["evaluations"]))
    return {row["scene"]: (row["method"], row[figure]) for row in rows}


def _runs(tables: Tables, name: str) -> str:
    return f"{filter_rows(tables, name)[0]['runs']} runs of each"


def _less(tables: Tables, name: str, systems: tuple[System, System], figure: str) -> tuple[Interval, str]:
    """How much less a figure is with the first system than with the second, %, over walks; and how it is written."""
    ours, theirs = (_walks(tables, name, each, figure) for each in systems)
    less = [100 * (1 - ours[walk][1] / theirs[walk][1]) for walk in ours]
    found, method = mean_interval(less), next(iter(theirs.values()))[0]
    return found, f"{found.text(unit=' % less')} than {method}, {len(less)} walks, {_runs(tables, name)}"


def _halves(system: System, subject: str, tables: Tables) -> Claim:
    found, text = _less(tables, "guided", (system, WALKING), "optimistic")
    what = f"Two cameras, {subject} person: optimistic error with 80 % fewer particles"
    return Claim(what, "more than 50 % less", text, found.above(50), "95 % interval over walks")


def _standard_fails(tables: Tables) -> Claim:
    found = _walks(tables, "guided", WALKING, "optimistic")
    error = mean_interval([error for _, error in found.values()])
    method = next(iter(found.values()))[0]
    text = f"{error.text(unit=' mm')} with {method}, {len(found)} walks, {_runs(tables, 'guided')}"
    limit = 2 * _THREE_CAMERAS
    what = "Two cameras: the standard annealed filter fails; optimistic error"
    why = f"fails is more than {limit:.0f} mm, twice that of Balan (2005) with three cameras; 95 % interval over walks"
    return Claim(what, "fails after about a second (Balan 2005)", text, error.above(limit), why)


def _lower_alone(tables: Tables) -> list[Claim]:
    """Whether the guided filter has lower errors with one camera, too."""
    if not filter_rows(tables, "guided_one_camera", system=WALKING_ALONE.name):
        return []
    claims, limit = [], 100 * MATTERS
    for figure in ("optimistic", "weighted_relative"):
        found, text = _less(tables, "guided_one_camera", (AGREEING, WALKING_ALONE), figure)
        what = f"One camera, known person, gamma = 5: {figure.replace('_', ' ')} error with 80 % fewer particles"
        why = f"by more than {limit:.0f} %; 95 % interval over walks"
        claims.append(Claim(what, "lower", text, found.above(limit), why))
    return claims


def _sits_back(tables: Tables) -> Claim:
    loose, tight = (_walks(tables, "guided_one_camera", each, "absolute") for each in (SITTING, AGREEING))
    more = mean_interval([loose[walk][1] - tight[walk][1] for walk in loose])
    text = f"{more.text(unit=' mm more')} than with gamma = 5, {len(loose)} walks"
    what = 'One camera: with gamma = 0 the body "sits back"'
    limit = MATTERS * mean_interval([error for _, error in tight.values()]).mean
    why = f"absolute error, by more than {limit:.0f} mm, a tenth; 95 % interval over walks"
    return Claim(what, "its place is wrong", text, more.above(limit), why)


def _recovers(tables: Tables) -> Claim:
    found = _walks(tables, "guided_one_camera", AGREEING, "weighted_relative")
    error = mean_interval([error for _, error in found.values()])
    text = f"{error.text(unit=' mm')}, {len(found)} walks, {_runs(tables, 'guided_one_camera')}"
    what = f"One camera, gamma = 5, rho_T = {TEMPERATURE}: weighted relative error"
    return Claim(what, "57 +- 5 mm", text, error.below(62), "at most 62 mm; 95 % interval over walks")


def _places(tables: Tables) -> Claim:
    found = _walks(tables, "guided_one_camera", AGREEING, "absolute")
    error = mean_interval([error for _, error in found.values()])
    text = f"{error.text(unit=' mm')} on the mean over frames, {len(found)} walks"
    what = "One camera, gamma = 5: absolute error, most of it depth"
    return Claim(what, "reaches almost 300 mm", text, "measured, without a verdict", "theirs is a largest value, of a figure")


def _best_particle(tables: Tables) -> Claim:
    method = filter_rows(tables, "trackers")[-1]["method"]
    best = find(tables["trackers"], "optimistic", method=method)
    what = "After Balan (2005): the best of an annealed filter's 1,000 particles, three cameras"
    ours = f"{best.text()} mm ({method}), four cameras at 30 Hz instead of 60"
    return Claim(what, "41 mm", ours, "none: another recording", "HumanEva is not at hand")


def _last(tables: Tables) -> str:
    """The filter of the most particles, with one camera."""
    method: str = filter_rows(tables, "one_camera")[-1]["method"]
    return method


def _held(table: Table) -> float:
    """Relative error of a tracker that holds the first pose."""
    held: float = table.records(system=STANDARD.name, method=HOLDING)[0]["relative"]
    return held


def _fails(tables: Tables) -> Claim:
    table, method = tables["one_camera"], _last(tables)
    error, relative = (find(table, name, system=STANDARD.name, method=method) for name in ("absolute", "relative"))
    holding = _held(table)
    ours = f"{error.text()} mm with the standard weight (Eq. 8); relative to the pelvis {relative.text()}"
    why = f"a tracker that holds the first pose has {holding:.0f}; by two standard errors"
    verdict = on_one_recording(verdict_of(relative.interval.low > holding))
    return Claim("With one camera the standard annealed filter fails", "within a second", ours, verdict, why)


def _keeps_the_place(tables: Tables) -> Claim:
    table, method = tables["one_camera"], _last(tables)
    error = find(table, "absolute", system=STANDARD.name, method=method)
    modified, posed = (find(table, name, system=MODIFIED.name, method=method) for name in ("absolute", "relative"))
    gain, uncertain = difference(error, modified)
    still = "still above" if posed.interval.low > _held(table) else "not above"
    ours = f"{modified.text()} mm, {gain:.0f} +- {uncertain:.0f} less"
    verdict = on_one_recording(Interval.around(gain, 2 * uncertain).above(MATTERS * error.mean))
    why = f"by more than a tenth, two standard errors over runs; relative to the pelvis {posed.text()}, {still} the held pose's"
    what = "Section 6.1: the modified weight (Eq. 9) keeps the place of the body better"
    return Claim(what, "it does", ours, verdict, why)


claims = claims_by_table(
    {
        "trackers": [_best_particle],
        "one_camera": [_fails, _keeps_the_place],
        "guided": [_standard_fails, partial(_halves, KNOWN, "known"), partial(_halves, UNKNOWN, "unknown")],
        "guided_one_camera": [_lower_alone, _sits_back, _recovers, _places],
    }
)


_TITLES = (
    ("Eq. 8, four cameras", "trackers", STANDARD),
    ("Eq. 8, one camera: the standard weight", "one_camera", STANDARD),
    ("Eq. 9, one camera: the modified weight", "one_camera", MODIFIED),
)


def trackers(tables: Tables) -> str:
    """Errors of the annealed filter with four cameras, and with one under both weights."""
    rows = []
    for title, table, system in _TITLES:
        for row in filter_rows(tables, table, system=system.name):
            count = row["method"].split(" x ")[1]
            rows.append([title, count, *told_errors(row), f"{row['seconds']:.2g}", str(row["runs"])])
    columns = ("weight", "particles a layer", "error", "relative", "best particle", "s a frame", "runs")
    return markdown(columns, rows)


def taught(name: str, jobs: Jobs, results: Results) -> list[Table]:
    """One row a system, walk and method."""
    return [Table(name, COLUMNS, [filter_row([job], results) for job in jobs["tracking"]], ABOUT)]


def guided_errors(tables: Tables) -> str:
    """Errors over walks, of which each is the mean of its runs, with 95 % intervals, and the deviation of runs of one walk."""
    rows = []
    for name in ("guided", "guided_one_camera"):
        groups = grouped(filter_rows(tables, name), lambda row: (row["system"], row["method"]))
        for (system, method), mine in groups.items():
            cells = [_over_walks(mine, figure) for figure in _GUIDED]
            seconds = sum(row["seconds"] for row in mine) / len(mine)
            rows.append([system, method, str(len(mine)), str(mine[0]["runs"]), *cells, f"{seconds:.2g}"])
    columns = ("system", "filter", "walks", "runs", "best particle", "error", "relative", "weighted, relative", "s a frame")
    return markdown(columns, rows)


_GUIDED = ("optimistic", "absolute", "relative", "weighted_relative")


def _over_walks(rows: Sequence[dict[str, Any]], figure: str) -> str:
    runs = math.sqrt(sum(row[f"{figure}_sd"] ** 2 for row in rows) / len(rows))
    return f"{mean_interval([row[figure] for row in rows]).text()}, runs +- {runs:.1f}"
