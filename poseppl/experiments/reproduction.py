"""Run an experiment, or parts of it: jobs, then tables, figures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath
from poseppl.experiments.experiment import Experiment, Part, Tables
from poseppl.experiments.jobs import Executor, JobProgress, run_jobs
from poseppl.experiments.jobs.versions import versions
from poseppl.experiments.page import write_page
from poseppl.experiments.provenance import Kept, Provenance, read_folder, write_folder
from poseppl.experiments.recordings import BUILT_IN, Recording
from poseppl.experiments.tables import Table, write_netcdf
from poseppl.report.picture import save_picture


def reproduce(
    experiment: Experiment,
    folder: FilePath,
    *,
    parts: Sequence[str] = (),
    recordings: Sequence[Recording] = (BUILT_IN,),
    scale: Any = None,
    executor: Executor | str | None = None,
    progress: JobProgress | None = None,
) -> Tables:
    """Run parts of an experiment; what the folder holds already is not computed again, and the page tells all of it.

    Args:
        experiment: The experiment.
        folder: Where jobs (``jobs/``), tables (CSV, ``tables.nc``), figures (PNG) and the page (``page.md``) go.
        parts: Names of the parts; all if empty.
        recordings: Who is seen; parts that see one take the first.
        scale: How much is computed; the experiment's ``full`` if None.
        executor: As :func:`poseppl.experiments.jobs.run_jobs` takes it.
        progress: Who is told.

    Returns:
        The tables of these parts by name.

    Raises:
        InputError: A recording or the folder cannot be used.
        JobError: Jobs failed; the results of the others are kept.
    """
    target, size = Path(folder), experiment.full if scale is None else scale
    tables: dict[str, Table] = {}
    for name in parts or experiment.parts:
        part = experiment.parts[name]
        tasks = part.plan(size, recordings)
        jobs = {key: task.jobs for key, task in tasks.items()}
        results: dict[str, Mapping[str, Any]] = {}
        for task in tasks.values():
            results |= run_jobs(task.function, task.jobs, target / "jobs", executor=executor, progress=progress)
        made = {table.name: table for table in part.tabulate(jobs, results)}
        tables |= made
        how = _provenance(experiment, name, size, recordings)
        write_folder(
            target, {key: Kept(table, how._replace(recordings=_seen(table, part, recordings))) for key, table in made.items()}
        )
        for file, picture in part.draw(tables, jobs, results).items():
            save_picture(picture, target / file)
        write_netcdf([each.table for each in read_folder(target).values()], target / "tables.nc")
        write_page(experiment, target)
    return tables


def _provenance(experiment: Experiment, part: str, scale: Any, recordings: Sequence[Recording]) -> Provenance:
    """How the tables of a part are made."""
    runs = str(experiment.parts[part].runs(scale))
    words = [f"poseppl reproduce {experiment.name} {part}"] + ["--quick"] * (scale == experiment.quick)
    return Provenance(
        runs if scale == experiment.full else f"{runs} (a smaller size than the paper's)",
        "",
        datetime.now(UTC).date().isoformat(),
        ", ".join(f"{name} {number}" for name, number in versions().items()),
        " ".join([*words, *filter(None, (recording.option for recording in recordings))]),
    )


def _seen(table: Table, part: Part, recordings: Sequence[Recording]) -> str:
    """Recordings of a table: those that it names, or those of its part."""
    told = {recording.name: recording.told for recording in recordings}
    names = list(told) if part.all_recordings else [recordings[0].name]
    if "recording" in table.columns:
        names = list(dict.fromkeys(table.column("recording")))
    return part.seen or ", ".join(told.get(name, name) for name in names)
