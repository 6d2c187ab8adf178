"""Executors of jobs: one interface, and the plainest form of it, this process.

An executor yields one :class:`Outcome` for each job, in any order. It keeps nothing and writes nothing; outcomes are kept by
key, so that a job that was computed twice, because a worker was lost, still counts once.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Generator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from poseppl.files.store import Arrays, Note
from poseppl.jobs.job import Job

Function = Callable[[Any], Mapping[str, Any]]
"""`job -> {name: array}`, at the top level of a module."""


class Outcome(NamedTuple):
    """Outcome of one job.

    Attributes:
        key: The job's.
        arrays: Its result; None when it failed.
        seconds: How long it took.
        error: Why it failed, in a line; empty when it did not.
        trace: The place of the failure.
    """

    key: str
    arrays: Arrays | None
    seconds: float = 0.0
    error: str = ""
    trace: str = ""


class Executor(Protocol):
    """Computes jobs."""

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """Compute jobs; closing the iterator stops what is still running.

        Args:
            function: The function that computes a job.
            jobs: Jobs by key, the costliest first.
            note: Called with messages for the user.

        Yields:
            One outcome for each job.
        """


class Inline:
    """Computes jobs one after the other in this process."""

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """See :class:`Executor`."""
        for key, job in jobs.items():
            yield perform(key, function, job)


def perform(key: str, function: Function, job: Job) -> Outcome:
    """Compute one job in this process; an exception becomes a part of the outcome."""
    start = time.perf_counter()
    try:
        arrays = _plain(function(job))
    except (Exception, SystemExit) as error:
        line = " ".join("".join(traceback.format_exception_only(error)).split())
        return Outcome(key, None, time.perf_counter() - start, line, "".join(traceback.format_exception(error)))
    return Outcome(key, arrays, time.perf_counter() - start)


def _plain(result: Mapping[str, Any]) -> Arrays:
    arrays = {str(name): np.asarray(value) for name, value in result.items()}
    for name, array in arrays.items():
        if array.dtype.kind not in "biufcSUmM":
            raise ValueError(f"the result {name!r} is of type {array.dtype}, which a file cannot hold")
    return arrays
