"""Table 4: seconds a frame of filters, of the mixture and of smoothers, with the published numbers of particles."""

from __future__ import annotations

from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import numpy as np

from poseppl_papers.experiment import Claim, Jobs, Results, Tables
from poseppl_papers.peursum.smoothed_walks import STAGES
from poseppl_papers.peursum.walk_tables import CIRCLES, kind_of
from poseppl_papers.tables import Table, grouped, markdown

COLUMNS = ("scene", "frames", "filter", "stage", "run", "seconds")
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
_ABOUT = "Seconds a frame on a core that others use, too; the mixture apart from the smoothers that stand on it."


def runtime_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a scene, filter, stage and run, without each job's first run, which compiles."""
    rows: list[tuple[Any, ...]] = []
    for job in jobs["runtimes"]:
        found = np.asarray(results[job.key]["stages"], float)
        for index, run in list(enumerate(job.runs))[1:]:
            for stage, seconds in zip(STAGES, found[index].tolist(), strict=True):
                rows.append((job.scene.name, job.num_frames, job.method.name, stage, run, seconds))
    return [Table("runtimes", COLUMNS, rows, _ABOUT)]


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
