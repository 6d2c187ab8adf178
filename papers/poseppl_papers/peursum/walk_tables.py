"""The tables of filters and smoothers on walks and of their run times (Table 4), and how the page tells them."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import numpy as np

from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.measured import mean_interval
from poseppl_papers.peursum.plan import BURN_IN_FRAMES
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS, STAGES
from poseppl_papers.tables import Table, grouped, markdown

COLUMNS = ("scene", "frames", "filter", "smoother", "run", "error", "seconds", "ess_share", "survivors")
FILTER, SMOOTHERS = ALGORITHMS[0], ALGORITHMS[1:]
CIRCLES, FURNITURE, ANNOUNCED = KINDS = ("circles", "furniture", "announced furniture")
"""Scenes: without furniture, among furniture as the paper has it, and where trackers are given its pixels."""
_ABOUT = (
    "Error of the mean posture at thirteen joints (mm), mean over frames from the sixth on; seconds a frame, those of a filter "
    "without compilation; shares of particles that are effective, and that have descendants three frames later."
)


def walk_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a scene, filter, smoother and run; seconds of smoothers are NaN in a job's first run, which compiles them."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["walks"]:
        found = results[job.key]
        for index, run in enumerate(job.runs):
            shares = float(found["ess_share"][index]), float(found["survivors"][index])
            for number, name in enumerate(ALGORITHMS[: found["errors"].shape[1]]):
                error = float(found["errors"][index, number, BURN_IN_FRAMES:].mean())
                seconds = float(found["seconds"][index, number]) if index or name == FILTER else np.nan
                rows.append((job.scene.name, job.num_frames, job.method.name, name, run, error, seconds, *shares))
    return [Table("walks", COLUMNS, rows, _ABOUT)]


def kind_of(scene: str) -> str:
    """One of :data:`KINDS`, from a scene's name."""
    place = scene.partition("-")[2]
    if not place.startswith("clutter"):
        return CIRCLES
    return FURNITURE if place.endswith("unannounced") else ANNOUNCED


def errors_by_person(tables: Tables, filter: str, smoother: str, kind: str, column: str = "error") -> dict[str, float]:
    """Mean error over runs (mm), or another column, of a filter and a smoother on each person's walk of a kind."""
    rows = [row for row in tables["walks"].records(filter=filter, smoother=smoother) if kind_of(row["scene"]) == kind]
    found = grouped(rows, lambda row: row["scene"].partition("-")[0])
    return {person: float(np.mean([row[column] for row in own])) for person, own in found.items()}


def filters_of(tables: Tables) -> list[str]:
    """Names of the filters, in the order of the table."""
    return tables["walks"].values("filter")


def gains(tables: Tables, filter: str, smoother: str, kind: str) -> dict[str, float]:
    """Difference of a filter's and its smoother's error, % of the filter's, by person; empty if it was not run."""
    own, before = (errors_by_person(tables, filter, name, kind) for name in (smoother, FILTER))
    return {person: 100 * (1 - own[person] / before[person]) for person in own if np.isfinite(own[person])}


def walks(tables: Tables) -> str:
    """Mean errors of all algorithms on all kinds of scenes, and what smoothers take away."""
    if "walks" not in tables:
        return ""
    rows = []
    for filter in filters_of(tables):
        for name in ALGORITHMS:
            cells = [_told(tables, filter, name, kind) for kind in (CIRCLES, FURNITURE)]
            seconds = tables["walks"].column("seconds", filter=filter, smoother=name).astype(float)
            cost = f"{np.nanmedian(seconds):.2g}" if np.isfinite(seconds).any() else ""
            known = _told(tables, filter, name, ANNOUNCED)[0] if name == FILTER else ""
            rows.append([filter, name, *(each for pair in cells for each in pair), known, cost])
    columns = ("filter", "smoother", *(f"{kind}: {what}" for kind in (CIRCLES, FURNITURE) for what in ("error", "less, %")))
    return markdown((*columns, f"{ANNOUNCED}: error", "s a frame"), rows)


def _told(tables: Tables, filter: str, name: str, kind: str) -> tuple[str, str]:
    errors = list(errors_by_person(tables, filter, name, kind).values())
    if not errors or not np.isfinite(errors).all():
        return "", ""
    less = "" if name == FILTER else mean_interval(list(gains(tables, filter, name, kind).values())).text()
    return mean_interval(errors).text(), less


RUNTIME_COLUMNS = ("scene", "frames", "filter", "stage", "run", "seconds")
HUMANEVA, CLUTTER = "circle", "furniture"
THEIRS: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    HUMANEVA: {
        "Simple-PF": (240, 138, 30, 40, 200),
        "Simple-APF": (245, 140, 14, 15, 93),
        "FSHHMM-PF": (25, 0.8, 0.5, 1.4, 1.7),
    },
    CLUTTER: {
        "Simple-PF": (95, 133, 30, 34, 108),
        "Simple-APF": (98, 134, 15, 12, 88),
        "FSHHMM-PF": (10, 0.8, 0.4, 0.8, 1.5),
    },
}
"""Table 4 by :data:`STAGES`, seconds a frame."""
_ABOUT_RUNTIMES = "Seconds a frame on a core that others use, too; the mixture apart from the smoothers that stand on it."


def runtime_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a scene, filter, stage and run, without each job's first run, which compiles."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["runtimes"]:
        found = np.asarray(results[job.key]["stages"], float)
        for index, run in list(enumerate(job.runs))[1:]:
            for stage, seconds in zip(STAGES, found[index].tolist(), strict=True):
                rows.append((job.scene.name, job.num_frames, job.method.name, stage, run, seconds))
    return [Table("runtimes", RUNTIME_COLUMNS, rows, _ABOUT_RUNTIMES)]


def runtimes(tables: Tables) -> str:
    """Ours and, in brackets, theirs."""
    if "runtimes" not in tables:
        return ""
    rows = []
    for (kind, filter), seconds in _medians(tables["runtimes"]).items():
        theirs = THEIRS[kind][filter.partition(",")[0]]
        shown = [f"{seconds[stage]:.2g} ({value:g})" for stage, value in zip(STAGES, theirs, strict=True)]
        rows.append([kind, filter, *shown])
    return markdown(("scene", "filter", "filtering", *STAGES[1:]), rows)


def runtime_claims(tables: Tables) -> list[Claim]:
    """The share of the time that smoothing adds to filtering, which says little of the machine."""
    own = {filter: seconds for (kind, filter), seconds in _medians(tables["runtimes"]).items() if kind == HUMANEVA}
    if not own:
        return []
    published = {filter: dict(zip(STAGES, THEIRS[HUMANEVA][filter.partition(",")[0]], strict=True)) for filter in own}
    theirs, ours = ("; ".join(f"{name} {_added(seconds)}" for name, seconds in each.items()) for each in (published, own))
    what = "Table 4: time of FBS, variational and Gibbs smoothing in percent of the filter's"
    why = "circle; the mixture counts for the last two"
    return [Claim(what, theirs, ours, "none: another machine", why)]


def _added(seconds: Mapping[str, float]) -> str:
    parts = [seconds["FBS"], *(seconds["mixture"] + seconds[name] for name in STAGES[3:])]
    return ", ".join(f"{100 * part / seconds['filter']:.0f}" for part in parts)


def _medians(table: Table) -> dict[tuple[str, str], dict[str, float]]:
    """Seconds a frame by kind of scene and filter, and then by stage."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for (scene, filter, stage), rows in grouped(table.records(), itemgetter("scene", "filter", "stage")).items():
        kind = HUMANEVA if kind_of(scene) == CIRCLES else CLUTTER
        found.setdefault((kind, filter), {})[stage] = float(np.median([row["seconds"] for row in rows]))
    return found
