"""Run the experiments, or some of them, and write tables, figures and the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from poseppl.experiments.choo_fleet.contest_tables import contest_table
from poseppl.experiments.choo_fleet.figures import draw_contest, draw_poses, draw_sequence, draw_tuning, draw_variances
from poseppl.experiments.choo_fleet.frame_tables import frame_tables
from poseppl.experiments.choo_fleet.page import write_page
from poseppl.experiments.choo_fleet.plan import FULL, PARTS, QUICK, Scale, Task, tasks_of
from poseppl.experiments.choo_fleet.sequence import SequenceRuns
from poseppl.experiments.choo_fleet.sequence_tables import performance, sequence_tables
from poseppl.experiments.choo_fleet.systems import BUILT_IN, SYSTEMS, Recording, stage_of
from poseppl.experiments.choo_fleet.tuning_tables import tuning_tables
from poseppl.experiments.tables import Table, write_csv, write_netcdf
from poseppl.io.files import atomic_path
from poseppl.jobs import Executor, JobProgress, run_jobs
from poseppl.jobs.archive import versions
from poseppl.report.picture import Picture, save_picture

Tables = dict[str, Table]
_FRAME = 10
"""The frame of Fig. 6."""


def reproduce(
    folder: str | Path,
    *,
    parts: Sequence[str] = PARTS,
    recordings: Sequence[Recording] = (BUILT_IN,),
    scale: Scale = FULL,
    executor: Executor | str | None = None,
    progress: JobProgress | None = None,
) -> Tables:
    """Run parts of the reproduction; what the folder holds already is not computed again.

    Args:
        folder: Where jobs (``jobs/``), tables (CSV, ``tables.nc``), figures (PNG) and the page (``page.md``) go.
        parts: Some of "single-frame", "sequence", "tuning" and "contest".
        recordings: Who is seen; sequences and tuning take the first.
        scale: How much is computed.
        executor: As :func:`poseppl.jobs.run_jobs` takes it.
        progress: Who is told.

    Returns:
        The tables by name.

    Raises:
        InputError: A recording or the folder cannot be used.
        JobError: Jobs failed; the results of the others are kept.
    """
    target = Path(folder)
    tables: Tables = {}
    pictures: dict[str, tuple[str, Picture]] = {}
    for part in parts:
        tasks = tasks_of(part, scale, recordings)
        results: dict[str, Any] = {}
        for task in tasks.values():
            results |= run_jobs(task.function, task.jobs, target / "jobs", executor=executor, progress=progress)
        tables |= {table.name: table for table in _TABULATE[part](tasks, results)}
        pictures |= _draw(part, tables, tasks, results)
        _write(target, tables, pictures, _notes(scale, recordings))
    return tables


def _tabulate_frames(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> list[Table]:
    frames: Any = tasks["frames"].jobs
    timings: Any = tasks["timings"].jobs
    return frame_tables(frames, timings, results)


def _tabulate_contest(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> list[Table]:
    one: Any = tasks["contest"].jobs
    frames: Any = tasks["frames"].jobs
    many: Any = [*tasks["contest sequences"].jobs, *tasks["contest trajectories"].jobs]
    return [contest_table(one, frames, results), performance("contest_sequences", many, results)]


def _tabulate_sequences(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> list[Table]:
    jobs: Any = tasks["sequences"].jobs
    return sequence_tables(jobs, results)


def _tabulate_tuning(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> list[Table]:
    jobs: Any = tasks["tuning"].jobs
    return tuning_tables(jobs, results)


_TABULATE: Mapping[str, Callable[[Mapping[str, Task], Mapping[str, Any]], list[Table]]] = {
    "single-frame": _tabulate_frames,
    "sequence": _tabulate_sequences,
    "tuning": _tabulate_tuning,
    "contest": _tabulate_contest,
}


def _draw(part: str, tables: Tables, tasks: Mapping[str, Task], results: Mapping[str, Any]) -> dict[str, tuple[str, Picture]]:
    """Figures of a part, with their titles, by file name."""
    if part == "single-frame":
        return {"variances.png": ("Variance against time and evaluations (Figs. 2 and 3)", draw_variances(tables))}
    if part == "sequence":
        drawn = {"sequence.png": ("Both filters over time (Figs. 4 and 5)", draw_sequence(tables))}
        poses = _poses(tasks, results)
        return drawn | ({"poses.png": ("Mean poses at frame 10 (Fig. 6)", draw_poses(poses))} if poses else {})
    if part == "tuning":
        return {"tuning.png": ("Tuning (section 7.5)", draw_tuning(tables))}
    return {"contest.png": ("The contest", draw_contest(tables))}


def _poses(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> dict[str, Any]:
    """Mean poses of six runs of each method on the full body."""
    jobs = [job for job in tasks["sequences"].jobs if isinstance(job, SequenceRuns) and job.system == "full_body"]
    if not jobs:
        return {}
    frame = min(_FRAME, jobs[0].num_frames - 1)
    stage = stage_of(jobs[0].recording, SYSTEMS["full_body"])
    names = list(stage.body.tree.marker_names)
    poses: dict[str, Any] = {"edges": [[names.index(end) for end in edge] for edge in stage.body.edges]}
    poses["truth"] = stage.markers[1 + frame]
    for job in jobs:
        if job.method not in poses:
            poses[job.method] = np.asarray(results[job.key]["markers"])[:6, frame]
    return poses


def _notes(scale: Scale, recordings: Sequence[Recording]) -> list[str]:
    """What was run, for the page."""
    seen = ", ".join(
        f"{recording.name} ({Path(recording.path).name})" if recording.path else recording.name for recording in recordings
    )
    size = "the paper's numbers" if scale == FULL else "fewer runs and settings than the paper's"
    used = ", ".join(f"{name} {number}" for name, number in versions().items())
    return [
        f"{scale.runs} runs ({size}) on: {seen}. One camera at 5 m, noise 0.003, random walk of 15 mm and 0.15 rad, 30 "
        "frames a second. Each process has one core to itself. A gradient counts as one evaluation.",
        f"With {used}.",
        f"To make it again: `{_command(scale, recordings)}`. What the folder holds already is not computed again.",
    ]


def _command(scale: Scale, recordings: Sequence[Recording]) -> str:
    """The command line, with the names of the files alone."""
    words = ["poseppl reproduce choo-fleet-2001"] + ["--quick"] * (scale == QUICK)
    for recording in recordings:
        if recording.path:
            files = [Path(file).name for file in (recording.path, recording.skeleton) if file]
            words.append(f"--motion {recording.name}={','.join(files)}")
    return " ".join(words)


def _write(target: Path, tables: Tables, pictures: Mapping[str, tuple[str, Picture]], notes: list[str]) -> None:
    for table in tables.values():
        write_csv(table, target)
    write_netcdf(tables.values(), target / "tables.nc")
    for name, (_, picture) in pictures.items():
        save_picture(picture, target / name)
    with atomic_path(target / "page.md") as temporary:
        temporary.write_text(
            write_page(tables, {name: title for name, (title, _) in pictures.items()}, notes), encoding="utf-8"
        )
