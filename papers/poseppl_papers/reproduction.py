"""Run an experiment, or parts of it: jobs, with one count of all and the time left, then tables, figures and the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from poseppl.errors import FilePath, InputError
from poseppl.jobs import Executor, JobProgress, run_jobs
from poseppl.jobs.job import versions
from poseppl.jobs.run import Silent, waiting
from poseppl.report.picture import save_picture
from poseppl_papers.experiment import Experiment, Part, Tables, Task
from poseppl_papers.page import write_page
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.tables import Kept, Provenance, Table, read_folder, write_folder, write_netcdf


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
        folder: Folder of jobs (``jobs/``), tables (CSV, ``tables.nc``), figures (PNG) and the page (``page.md``).
        parts: Names of the parts; if empty, all, or those that the built-in walk is enough for where nothing else is seen.
        recordings: Recordings of the people that are seen; parts with one person use the first.
        scale: How much is computed; the experiment's ``full`` if None.
        executor: As :func:`poseppl.jobs.run_jobs` takes it.
        progress: Callback for the progress.

    Returns:
        The tables of these parts by name.

    Raises:
        InputError: A recording or the folder cannot be used, or the recordings are not enough for a part; before the first job.
        JobError: Jobs failed; the results of the others are kept.
    """
    target, size, progress = Path(folder), experiment.full if scale is None else scale, progress or Silent()
    tables: dict[str, Table] = {}
    plans = _plans(experiment, parts, size, recordings, progress)
    total = TotalProgress(progress, [task for tasks in plans.values() for task in tasks.values()], target / "jobs")
    for name, tasks in plans.items():
        part = experiment.parts[name]
        jobs = {key: task.jobs for key, task in tasks.items()}
        results: dict[str, Mapping[str, Any]] = {}
        for task in tasks.values():
            own = total.of_task(task)
            results |= run_jobs(task.function, task.jobs, target / "jobs", executor=executor, progress=own)
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


def _plans(
    experiment: Experiment, parts: Sequence[str], scale: Any, recordings: Sequence[Recording], progress: JobProgress
) -> dict[str, Mapping[str, Task]]:
    """The tasks of the parts, all before the first job is run.

    Raises:
        InputError: The recordings are not enough for a part.
    """
    plans: dict[str, Mapping[str, Task]] = {}
    obstacles: dict[str, InputError] = {}
    for name in parts or experiment.parts:
        try:
            plans[name] = experiment.parts[name].plan(scale, recordings)
        except InputError as error:
            obstacles[name] = error
    if obstacles and (parts or not plans or list(recordings) != [BUILT_IN]):
        name, reason = next(iter(obstacles.items()))
        others = f"; without it: poseppl reproduce {experiment.name} {' '.join(plans)}" if plans else ""
        raise InputError(f"the part {name} cannot be run: {reason}{others}") from reason
    for name, reason in obstacles.items():
        progress.note(f"the part {name} is left out: {reason}")
    return plans


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
    described = {recording.name: recording.description for recording in recordings}
    names = list(described) if part.all_recordings else [recordings[0].name]
    if "recording" in table.columns:
        names = list(dict.fromkeys(table.column("recording")))
    return part.seen or ", ".join(described.get(name, name) for name in names)


class TotalProgress:
    """Adds up tasks that are run one after the other.

    Costs compare the jobs of one task alone. A job counts as its cost over the mean of its task's; so the time left is that of
    jobs which take as long as those before, whatever their task.

    Args:
        progress: Callback for the progress of all of them.
        tasks: The tasks; those that share a job have it once.
        folder: Folder of the results.
    """

    def __init__(self, progress: JobProgress, tasks: Sequence[Task], folder: Path) -> None:
        self._progress = progress
        jobs = {job.key for task in tasks for job in task.jobs}
        missing: dict[str, float] = {}
        for task in tasks:
            for job in waiting(task.function, task.jobs, folder):
                missing.setdefault(job.key, job.cost / mean_cost(task))
        progress.started(len(jobs), len(jobs) - len(missing), sum(missing.values()))

    def of_task(self, task: Task) -> JobProgress:
        """Callback for one of them."""
        return _Share(self._progress, mean_cost(task))


class _Share:
    """Passes on the progress of one task."""

    def __init__(self, progress: JobProgress, unit: float) -> None:
        self._progress, self._unit = progress, unit

    def started(self, total: int, done: int, cost: float) -> None:
        """Do nothing: all tasks were reported together."""

    def finished(self, cost: float) -> None:
        """One more job is done or has failed."""
        self._progress.finished(cost / self._unit)

    def note(self, message: str) -> None:
        """Something that the user should know."""
        self._progress.note(message)


def mean_cost(task: Task) -> float:
    """Mean cost of a task's jobs; 1 where there are none."""
    return sum(job.cost for job in task.jobs) / len(task.jobs) if task.jobs else 1.0
