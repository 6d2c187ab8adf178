"""Run jobs: read what is there, compute the rest, write each result as it comes.

A job's arrays are in ``KEY.npz``. A record in it names the job, its function, the versions of the libraries and poseppl's
source. Results of other versions are computed again; those of another job or function are left
alone and refused.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from typing import Any, Protocol

from poseppl.errors import FilePath, InputError, PosepplError, brief
from poseppl.files.store import Arrays, Store
from poseppl.jobs.cluster import Cluster, Processes
from poseppl.jobs.job import Executor, Function, Inline, Job, Outcome, versions

_FORMAT = 2
_SHOWN = 5
"""Failed jobs that a message names, and files that cannot be used."""


class JobError(PosepplError):
    """Jobs that failed; the results of the others are kept.

    Attributes:
        failures: Why each of them failed, by key.
        traces: Where.
    """

    def __init__(self, failed: Sequence[Outcome], total: int) -> None:
        lines = [f"  {outcome.key}: {outcome.error}" for outcome in failed[:_SHOWN]]
        more = [f"  and {len(failed) - _SHOWN} more"] if len(failed) > _SHOWN else []
        super().__init__(
            "\n".join([f"{len(failed)} of {total} jobs failed; the results of the others are kept", *lines, *more])
        )
        self.failures = {outcome.key: outcome.error for outcome in failed}
        self.traces = {outcome.key: outcome.trace for outcome in failed}


def run_jobs(
    function: Function,
    jobs: Iterable[Job],
    folder: FilePath,
    *,
    executor: Executor | str | None = None,
    progress: JobProgress | None = None,
) -> dict[str, Arrays]:
    """Run independent jobs; those with results in the folder are not computed again.

    Args:
        function: `job -> {name: array}`. It is imported by other processes, so it is at the top level of a module, and a script
            that calls `run_jobs` does so below ``if __name__ == "__main__":``. The same job gives the same arrays.
        jobs: The jobs, no two alike.
        folder: The folder of the results, ``KEY.npz``, each written when it is computed.
        executor: An executor, "processes" (one for each core, and so if None), "inline" (this process), or the
            address of a Dask scheduler, such as "tcp://host:8786".
        progress: Receives the progress, for example a `poseppl.cli.console.ConsoleProgress`.

    Returns:
        The arrays of every job, by its key, in the order of the jobs.

    Raises:
        JobError: Jobs failed.
        InputError: The folder cannot be used, or the executor cannot.
        ValueError: Two jobs are alike, a field of a job is not of plain values, or other processes cannot import the function.
    """
    progress = progress or Silent()
    _check_function(function)
    wanted = _by_key(jobs)
    messages: list[str] = []
    store = Store(folder, "results", messages.append)
    records = {key: _record(function, job) for key, job in wanted.items()}
    loaded = {key: store.load(key, record, owners=("job", "function")) for key, record in records.items()}
    results = {key: arrays for key, arrays in loaded.items() if arrays is not None}
    more = [f"and {len(messages) - _SHOWN} more files in {folder}"] if len(messages) > _SHOWN else []
    for message in [*messages[:_SHOWN], *more]:
        progress.note(message)
    costliest = sorted(wanted.items(), key=lambda item: -item[1].cost)
    missing = {key: job for key, job in costliest if key not in results}
    progress.started(len(wanted), len(results), sum(job.cost for job in missing.values()))
    failed: list[Outcome] = []
    chosen = find_executor(executor) if missing else Inline()
    with closing(chosen.outcomes(function, missing, progress.note)) as outcomes:
        for outcome in outcomes:
            if outcome.arrays is None:
                failed.append(outcome)
            else:
                store.save(outcome.key, outcome.arrays, {**records[outcome.key], "seconds": outcome.seconds})
                results[outcome.key] = outcome.arrays
            progress.finished(missing[outcome.key].cost)
    if failed:
        raise JobError(failed, len(wanted))
    return {key: results[key] for key in wanted}


def waiting(function: Function, jobs: Iterable[Job], folder: FilePath) -> list[Job]:
    """Those of some jobs that :func:`run_jobs` would compute, which have no results in the folder.

    Args:
        function: As for :func:`run_jobs`.
        jobs: The jobs.
        folder: The folder of the results.
    """
    store = Store(folder, "results", lambda message: None)
    return [job for job in jobs if not store.holds(job.key, _record(function, job))]


def find_executor(executor: Executor | str | None) -> Executor:
    """The executor of a name or an address; None is one process for each core.

    Raises:
        InputError: The text is neither.
    """
    if executor is None or executor == "processes":
        return Processes()
    if executor == "inline":
        return Inline()
    if not isinstance(executor, str):
        return executor
    if ":" not in executor:
        raise InputError(
            f"no executor {brief(executor)}", expected="inline, processes, or a Dask scheduler such as tcp://host:8786"
        )
    return Cluster(executor)


def _record(function: Function, job: Job) -> dict[str, Any]:
    computed_by = f"{function.__module__}.{function.__qualname__}"
    return {"format": _FORMAT, "versions": versions(), "job": job.contents, "function": computed_by}


def _check_function(function: Function) -> None:
    name = getattr(function, "__qualname__", "")
    main = function.__module__ == "__main__" and not hasattr(sys.modules["__main__"], "__file__") if name else False
    if not name.isidentifier() or main:
        raise ValueError(f"{brief(function)} cannot be imported by another process. Define it at the top level of a module.")


def _by_key(jobs: Iterable[Job]) -> Mapping[str, Job]:
    wanted: dict[str, Job] = {}
    for job in jobs:
        key = job.key
        if key in wanted:
            raise ValueError(
                f"two jobs are equal: {job}. A job is computed once; give each a field of its own, such as its run."
            )
        wanted[key] = job
    return wanted


class JobProgress(Protocol):
    """Receives the progress of jobs."""

    def started(self, total: int, done: int, cost: float) -> None:
        """There are so many jobs, so many of them done before; the others cost so much."""

    def finished(self, cost: float) -> None:
        """One more job is done or has failed; it cost so much."""

    def note(self, message: str) -> None:
        """Something that the user should know."""


class Silent:
    """Reports nothing."""

    def started(self, total: int, done: int, cost: float) -> None:
        """See :class:`JobProgress`."""

    def finished(self, cost: float) -> None:
        """See :class:`JobProgress`."""

    def note(self, message: str) -> None:
        """See :class:`JobProgress`."""
