"""Local processes that compute jobs: a Dask cluster of this machine's, each worker on cores of its own.

XLA uses all the cores that a process may run on. A worker is therefore pinned to its share of them before JAX starts there;
where the system cannot (macOS), workers compete. A worker that dies is replaced, and ends when this process does. Workers have
environment variables of this process, settings made in it they do not; they accept work only with the certificate that this
process makes for them.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from poseppl.checks import check_at_least
from poseppl.errors import InputError
from poseppl.files.store import Note
from poseppl.jobs.cluster import Tasks, distributed
from poseppl.jobs.job import Function, Job, Outcome

Prepare = Callable[[], None]
_SETTINGS: Mapping[str, Any] = {
    "distributed.scheduler.worker-saturation": 1.0,  # a worker has the job that it computes, and no other
    "distributed.worker.profile.enabled": False,  # jobs measure time
    "distributed.nanny.pre-spawn-environ": {},
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}


class Processes(NamedTuple):
    """Computes jobs in local processes.

    Attributes:
        max_workers: How many; one for each core that this process may use, if None.
        pin: Whether each is kept to its share of those cores.
        attempts: How often a job is tried whose process dies.
        prepare: Called in each process before its first job; at the top level of a module.
    """

    max_workers: int | None = None
    pin: bool = True
    attempts: int = 3
    prepare: Prepare | None = None

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """See :class:`~poseppl.jobs.job.Executor`.

        Raises:
            InputError: Dask, or what it makes certificates with, is not installed.
        """
        cores = available_cores()
        number = len(cores) if self.max_workers is None else self.max_workers
        check_at_least(1, max_workers=number, attempts=self.attempts)
        shares = core_shares(cores, min(number, len(jobs)))
        with local_workers(shares, self.pin, self.prepare) as client:
            yield from Tasks(client, function, jobs, self.attempts).outcomes(note)


@contextmanager
def local_workers(shares: Sequence[Sequence[int]], pin: bool, prepare: Prepare | None) -> Iterator[Any]:
    """Start workers, and end them after the block, whatever they do.

    Args:
        shares: The cores of each worker.
        pin: Whether it is kept to them.
        prepare: Called in each.

    Yields:
        A `distributed.Client` of them.

    Raises:
        InputError: Dask, or what it makes certificates with, is not installed.
    """
    dask_distributed = distributed()
    import dask

    from poseppl.jobs.worker_setup import WorkerSetup

    try:
        security = dask_distributed.Security.temporary()
    except ImportError as error:
        raise InputError(f"{error}", expected="pip install 'poseppl[experiments]'") from error
    with dask.config.set(_SETTINGS):
        cluster = dask_distributed.LocalCluster(
            n_workers=len(shares),
            threads_per_worker=1,
            memory_limit=0,
            scheduler_kwargs={"allowed_failures": 0},
            security=security,
            plugins=(WorkerSetup(shares if pin else (), prepare),),
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        )
    with cluster, dask_distributed.Client(cluster, set_as_default=False) as client:
        try:
            yield client
        finally:
            cluster.sync(_stop, list(cluster.workers.values()))


async def _stop(nannies: Sequence[Any]) -> None:
    await asyncio.gather(*(nanny.close(timeout=0.5) for nanny in nannies), return_exceptions=True)


def available_cores() -> list[int]:
    """The cores that this process may run on."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def core_shares(cores: Sequence[int], number: int) -> list[list[int]]:
    """Share cores among workers: each gets as many as any other, give or take one; more workers than cores take turns."""
    shares = np.array_split(np.asarray(cores), number)
    return [share.tolist() or [cores[index % len(cores)]] for index, share in enumerate(shares)]
