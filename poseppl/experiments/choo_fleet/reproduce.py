"""Run the experiments, or some of them, and write tables, figures and the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
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
from poseppl.experiments.choo_fleet.systems import BUILT_IN, Recording, stage_of
from poseppl.experiments.choo_fleet.tuning_tables import tuning_tables
from poseppl.experiments.jobs import Executor, JobProgress, run_jobs
from poseppl.experiments.jobs.versions import versions
from poseppl.experiments.provenance import Kept, Provenance, read_folder, write_folder
from poseppl.experiments.tables import Table, write_netcdf
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
    """Run parts of the reproduction; what the folder holds already is not computed again, and the page tells all of it.

    Args:
        folder: Where jobs (``jobs/``), tables (CSV, ``tables.nc``), figures (PNG) and the page (``page.md``) go.
        parts: Some of "single-frame", "sequence", "tuning" and "contest".
        recordings: Who is seen; sequences and tuning take the first.
        scale: How much is computed.
        executor: As :func:`poseppl.experiments.jobs.run_jobs` takes it.
        progress: Who is told.

    Returns:
        The tables of these parts by name.

    Raises:
        InputError: A recording or the folder cannot be used.
        JobError: Jobs failed; the results of the others are kept.
    """
    target = Path(folder)
    tables: Tables = {}
    for part in parts:
        tasks = tasks_of(part, scale, recordings)
        results: dict[str, Any] = {}
        for task in tasks.values():
            results |= run_jobs(task.function, task.jobs, target / "jobs", executor=executor, progress=progress)
        made = {table.name: table for table in _TABULATE[part]({name: task.jobs for name, task in tasks.items()}, results)}
        tables |= made
        write_folder(target, {name: Kept(table, _provenance(table, part, scale, recordings)) for name, table in made.items()})
        for file, picture in _draw(part, tables, tasks, results).items():
            save_picture(picture, target / file)
        write_netcdf([each.table for each in read_folder(target).values()], target / "tables.nc")
        write_page(target)
    return tables


_TABULATE: Mapping[str, Callable[[Mapping[str, Any], Mapping[str, Any]], list[Table]]] = {
    "single-frame": lambda jobs, results: frame_tables(jobs["frames"], jobs["timings"], results),
    "sequence": lambda jobs, results: sequence_tables(jobs["sequences"], results),
    "tuning": lambda jobs, results: tuning_tables(jobs["tuning"], results),
    "contest": lambda jobs, results: [
        contest_table(jobs["contest"], jobs["frames"], results),
        performance("contest_sequences", [*jobs["contest sequences"], *jobs["contest trajectories"]], results),
    ],
}
"""Of each part its tables, from the jobs of its tasks and their results."""


def _draw(part: str, tables: Tables, tasks: Mapping[str, Task], results: Mapping[str, Any]) -> dict[str, Picture]:
    """Figures of a part by file name."""
    if part == "single-frame":
        return {"variances.png": draw_variances(tables)}
    if part == "sequence":
        poses = _poses(tasks, results)
        return {"sequence.png": draw_sequence(tables)} | ({"poses.png": draw_poses(poses)} if poses else {})
    return {"tuning.png": draw_tuning(tables)} if part == "tuning" else {"contest.png": draw_contest(tables)}


def _poses(tasks: Mapping[str, Task], results: Mapping[str, Any]) -> dict[str, Any]:
    """Mean poses of six runs of the paper's two filters on the full body."""
    known = [job for job in tasks["sequences"].jobs if isinstance(job, SequenceRuns) and job.system == "full_body"]
    jobs = [job for job in known if job.method in ("HMC filter", "particle filter")]
    if not jobs:
        return {}
    frame = min(_FRAME, jobs[0].num_frames - 1)
    stage = stage_of(jobs[0].recording, "full_body")
    names = list(stage.body.tree.marker_names)
    poses: dict[str, Any] = {"edges": [[names.index(end) for end in edge] for edge in stage.body.edges]}
    poses["truth"] = stage.markers[1 + frame]
    for job in jobs:
        if job.method not in poses:
            poses[job.method] = np.asarray(results[job.key]["markers"])[:6, frame]
    return poses


def _provenance(table: Table, part: str, scale: Scale, recordings: Sequence[Recording]) -> Provenance:
    """How a table of a part is made."""
    runs = {"tuning": scale.tuning_runs, "contest": min(scale.runs, scale.contest_runs)}.get(part, scale.runs)
    told = {recording.name: _told(recording) for recording in recordings}
    seen = list(told) if part in ("single-frame", "contest") else [recordings[0].name]
    if "recording" in table.columns:
        seen = list(dict.fromkeys(table.column("recording")))
    return Provenance(
        str(runs) if scale == FULL else f"{runs} (a smaller size than the paper's)",
        ", ".join(told.get(name, name) for name in seen),
        datetime.now(UTC).date().isoformat(),
        ", ".join(f"{name} {number}" for name, number in versions().items()),
        _command(part, scale, recordings),
    )


def _told(recording: Recording) -> str:
    return f"{recording.name} ({Path(recording.path).name})" if recording.path else recording.name


def _command(part: str, scale: Scale, recordings: Sequence[Recording]) -> str:
    """The command line, with the names of the files alone."""
    words = [f"poseppl reproduce choo-fleet-2001 {part}"] + ["--quick"] * (scale == QUICK)
    for recording in recordings:
        if recording.path:
            files = [Path(file).name for file in (recording.path, recording.skeleton) if file]
            words.append(f"--motion {recording.name}={','.join(files)}")
    return " ".join(words)
