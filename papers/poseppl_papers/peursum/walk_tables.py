"""The table of filters and smoothers on walks, and how the page tells it."""

from __future__ import annotations

from typing import Any

import numpy as np

from poseppl_papers.experiment import Jobs, Results, Tables
from poseppl_papers.measured import mean_interval
from poseppl_papers.peursum.plan import BURN_IN_FRAMES
from poseppl_papers.peursum.smoothed_walks import ALGORITHMS
from poseppl_papers.tables import Table, grouped, markdown

COLUMNS = ("scene", "frames", "filter", "smoother", "run", "error", "seconds", "ess_share", "survivors")
FILTER, SMOOTHERS = ALGORITHMS[0], ALGORITHMS[1:]
KINDS = {"circles": False, "furniture": True}
"""Scenes, and whether their names are those of rooms with furniture."""
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
            told = float(found["ess_share"][index]), float(found["survivors"][index])
            for number, name in enumerate(ALGORITHMS[: found["errors"].shape[1]]):
                error = float(found["errors"][index, number, BURN_IN_FRAMES:].mean())
                seconds = float(found["seconds"][index, number]) if index or name == FILTER else np.nan
                rows.append((job.scene.name, job.num_frames, job.method.name, name, run, error, seconds, *told))
    return [Table("walks", COLUMNS, rows, _ABOUT)]


def errors_by_scene(tables: Tables, filter: str, smoother: str, furniture: bool) -> dict[str, float]:
    """Mean error over runs (mm) of a filter and a smoother on each scene of a kind."""
    rows = [row for row in tables["walks"].records(filter=filter, smoother=smoother) if is_cluttered(row["scene"]) == furniture]
    found = grouped(rows, lambda row: row["scene"])
    return {scene: float(np.mean([row["error"] for row in own])) for scene, own in found.items()}


def is_cluttered(scene: str) -> bool:
    """Whether a scene's name is that of a room with furniture."""
    return scene.partition("-")[2].startswith("clutter")


def filters_of(tables: Tables) -> list[str]:
    """Names of the filters, in the order of the table."""
    return tables["walks"].values("filter")


def gains(tables: Tables, filter: str, smoother: str, furniture: bool) -> list[float]:
    """How much lower (mm) a smoother's error is than its filter's, on each scene of a kind; empty where it was not run."""
    own, before = (errors_by_scene(tables, filter, name, furniture) for name in (smoother, FILTER))
    return [before[scene] - own[scene] for scene in own if np.isfinite(own[scene])]


def walks(tables: Tables) -> str:
    """Mean errors of all algorithms on both kinds of scenes, and what smoothers take away."""
    if "walks" not in tables:
        return ""
    rows = []
    for filter in filters_of(tables):
        for name in ALGORITHMS:
            told = [_told(tables, filter, name, furniture) for furniture in KINDS.values()]
            seconds = tables["walks"].column("seconds", filter=filter, smoother=name).astype(float)
            cost = f"{np.nanmedian(seconds):.2g}" if np.isfinite(seconds).any() else ""
            rows.append([filter, name, *(each for pair in told for each in pair), cost])
    columns = ("filter", "smoother", *(f"{kind}: {what}" for kind in KINDS for what in ("error", "less")), "s a frame")
    return markdown(columns, rows)


def _told(tables: Tables, filter: str, name: str, furniture: bool) -> tuple[str, str]:
    errors = list(errors_by_scene(tables, filter, name, furniture).values())
    if not errors or not np.isfinite(errors).all():
        return "", ""
    return f"{np.mean(errors):.0f}", "" if name == FILTER else mean_interval(gains(tables, filter, name, furniture)).told()
