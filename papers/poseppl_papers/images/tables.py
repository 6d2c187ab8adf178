"""Tables and figures of filters on scenes, and how pages tell them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats
from poseppl.report.picture import Picture, new_picture
from poseppl_papers.experiment import Jobs, Pictures, Results, Tables
from poseppl_papers.images.tracking import CLOSEST, FIGURES, HOLDING, Blind, Tracking
from poseppl_papers.measured import measured, over_runs
from poseppl_papers.runs import joined
from poseppl_papers.tables import Table, grouped, rows_of

COLUMNS = (
    *("system", "scene", "cameras", "frames", "runs", "method", "evaluations"),
    *(name + end for name in FIGURES for end in ("", "_sd")),
    *("seconds", "weight", "weight_sd", "failed"),
)
ERRORS_ARE = (
    "Filters run on a recorded walk, rendered at 30 Hz in a room with a camera of 640 x 480 in every corner. Errors are mean "
    'distances of fifteen virtual markers from the truth, mm, +- standard deviation over runs, and "best particle" is the '
    "optimistic error. The body has the person's size, and the start is the true first pose."
)
"""Text of all pages of such experiments."""
ABOUT = (
    "Errors of fifteen virtual markers, mm: of the mean, relative to the pelvis, the particles' mean relative error by weight, "
    "and that of the best particle; means over runs of each run's mean over frames, and standard deviations over runs, without "
    "the frame where a run starts. Seconds a frame are the median's, without features and compilation; weight is the mean "
    "likelihood of a frame's particles."
)


def tracking_table(name: str, blind: Sequence[Blind], jobs: Sequence[Tracking], results: Results) -> Table:
    """One row a system, scene and method, the two trackers that see nothing before the others."""
    rows: list[tuple[Any, ...]] = []
    for job in blind:
        rows += _blind_rows(job, results[job.key]["errors"])
        own = [each for each in jobs if (each.scene, each.system, each.num_frames) == (job.scene, job.system, job.num_frames)]
        rows += [filter_row(group, results) for group in grouped(own, lambda each: each.method.name).values()]
    return Table(name, COLUMNS, rows, ABOUT)


def _head(job: Blind | Tracking, runs: int, method: str) -> tuple[Any, ...]:
    return job.system.name, job.scene.name, job.system.views, job.num_frames, runs, method


def _blind_rows(job: Blind, errors: Floats) -> Iterator[tuple[Any, ...]]:
    for method, each in zip((HOLDING, CLOSEST), errors, strict=True):
        figures = [number for mean in each[1:].mean(0) for number in (float(mean), np.nan)]
        yield *_head(job, 1, method), 0, *figures, np.nan, np.nan, np.nan, 0


def filter_row(jobs: Sequence[Tracking], results: Results) -> tuple[Any, ...]:
    """The row of a filter, of all jobs with its runs."""
    found = joined(jobs, results)
    errors = found["errors"][:, 1:].mean(1)
    figures = [number for column in errors.T for number in over_runs(column.tolist())[:2]]
    weight = over_runs(found["weight"].mean(1).tolist())
    head = _head(jobs[0], len(errors), jobs[0].method.name)
    seconds = float(np.median(found["seconds"][:, 1:]))
    return *head, int(found["evaluations"][0]), *figures, seconds, *weight[:2], int(found["failed"].sum())


def told_errors(row: Mapping[str, Any]) -> list[str]:
    """Absolute, relative and best particle's errors of a row, mm, with their standard deviations over runs."""
    return [measured(row, name).text() for name in ("absolute", "relative", "optimistic")]


def tracked(name: str, jobs: Jobs, results: Results) -> list[Table]:
    """The one table of a part of :func:`poseppl_papers.images.tracking.tracking_tasks`."""
    return [tracking_table(name, jobs["blind"], jobs["tracking"], results)]


def filter_rows(tables: Tables, name: str, **where: Any) -> list[dict[str, Any]]:
    """Rows of filters, without those of trackers that see nothing; none where there is no such table."""
    return [row for row in rows_of(tables, name, **where) if row["method"] not in (HOLDING, CLOSEST)]


COLOURS = ("#1f6f8b", "#e4572e", "#6b8f3c", "#8a5fa8", "#c58b1b", "#3f3f46", "#b3261e", "#2f9c95")
_FIGURES = {"absolute": "mean's error, mm", "relative": "relative to the pelvis, mm", "optimistic": "best particle's error, mm"}


def draw_errors(table: Table) -> Picture:
    """A panel for each figure: methods downwards, a mark for each system and scene, with the standard deviation over runs."""
    rows = [row for row in table.records() if row["method"][0] != "("]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    groups = grouped(rows, lambda row: (row["system"], row["scene"]))
    picture = new_picture(4.0 * len(_FIGURES), 1.6 + 0.22 * len(methods) * (1 + len(groups)))
    axes = picture.subplots(1, len(_FIGURES), sharey=True, squeeze=False)[0]
    for axis, (figure, label) in zip(axes, _FIGURES.items(), strict=True):
        for number, (group, mine) in enumerate(groups.items()):
            place = [methods.index(row["method"]) + 0.7 * (number + 0.5) / len(groups) for row in mine]
            spread = np.nan_to_num([row[f"{figure}_sd"] for row in mine])
            colour = COLOURS[number % len(COLOURS)]
            axis.errorbar([row[figure] for row in mine], place, xerr=spread, fmt="o", color=colour, label=", ".join(group))
            held = [row[figure] for row in table.records(method=HOLDING, system=group[0], scene=group[1])]
            if held and figure == "relative":
                axis.axvline(held[0], color=colour, linestyle=":", linewidth=1)
        axis.set(xlabel=label, ylim=(len(methods), 0))
        axis.set_xlim(left=0)
    axes[0].set_yticks(np.arange(len(methods)) + 0.35, methods)
    picture.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2, fontsize=8)
    return picture


def draw_scenes(table: Table) -> Picture:
    """A panel for each figure: systems and methods downwards, a mark for each scene, and a bar at their mean."""
    groups = grouped(table.records(), lambda row: (row["system"], row["method"]))
    picture = new_picture(4.0 * len(_FIGURES) + 2.0, 1.0 + 0.45 * len(groups))
    axes = picture.subplots(1, len(_FIGURES), sharey=True, squeeze=False)[0]
    for axis, (figure, label) in zip(axes, _FIGURES.items(), strict=True):
        for number, rows in enumerate(groups.values()):
            values = [row[figure] for row in rows]
            axis.plot(values, np.full(len(values), number), "o", color=COLOURS[0], alpha=0.5, label="a walk, mean of its runs")
            axis.plot([np.mean(values)] * 2, [number - 0.3, number + 0.3], color=COLOURS[1], linewidth=2, label="mean of walks")
        axis.set(xlabel=label, ylim=(len(groups) - 0.5, -0.5))
        axis.set_xlim(left=0)
    axes[0].set_yticks(np.arange(len(groups)), [": ".join(group) for group in groups])
    handles, labels = axes[0].get_legend_handles_labels()
    picture.legend(handles[:2], labels[:2], loc="outside upper center", ncols=2, fontsize=8)
    return picture


def drawn_scenes(name: str, tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """That figure of a table, in the file of its name."""
    return {f"{name}.png": draw_scenes(tables[name])}


def drawn_errors(name: str, tables: Tables, jobs: Jobs, results: Results) -> Pictures:
    """That figure of a table, in the file of its name."""
    return {f"{name}.png": draw_errors(tables[name])}
