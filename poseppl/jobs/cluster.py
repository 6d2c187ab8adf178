"""Dask clusters that compute jobs: one named by the address of its scheduler, or local processes, each on cores of its own.

Each job is one task. When a worker dies, its scheduler blames every task of the worker, tries them on other workers, and
gives them up when it has seen too many deaths (`distributed.scheduler.allowed-failures`). These jobs are tried again when all
others are done, one at a time. Then only jobs that kill workers fail, and jobs that had too little memory beside others have
enough. Results travel to this process, which alone writes files, so no folder need be shared. Workers need poseppl, the job's
module, and the versions that are installed here; start them with one thread each (``dask worker ADDRESS --nthreads 1``).

XLA uses all the cores that a process may run on. A worker is therefore pinned to its share of them before JAX starts there;
where the system cannot (macOS), workers compete. A worker that dies is replaced, and ends when this process does. Workers have
environment variables of this process, settings made in it they do not; they accept work only with the certificate that this
process makes for them.
"""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np

from poseppl.checks import check_at_least
from poseppl.errors import InputError, PosepplError
from poseppl.files.store import Note
from poseppl.jobs.job import Function, Job, Outcome, perform, versions


class Cluster(NamedTuple):
    """Computes jobs on a Dask cluster.

    Attributes:
        address: Address of the scheduler, such as "tcp://host:8786".
        timeout: Seconds within which the scheduler must answer and have a worker.
    """

    address: str
    timeout: float = 10.0

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Generator[Outcome]:
        """See :class:`~poseppl.jobs.job.Executor`.

        Raises:
            InputError: Dask is not installed, no scheduler answers, or it has no workers.
            PosepplError: The scheduler was lost.
        """
        expected = "the address of a running Dask scheduler, such as tcp://host:8786"
        try:
            client = distributed().Client(self.address, timeout=self.timeout, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at {self.address}", expected=expected) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=self.timeout)
            except TimeoutError as error:
                raise InputError(f"the Dask scheduler at {self.address} has no workers", expected="at least one") from error
            yield from Tasks(client, function, jobs).outcomes(note)


def distributed() -> ModuleType:
    """Dask's module for clusters.

    Raises:
        InputError: It is not installed.
    """
    try:
        import distributed
    except ImportError as error:
        raise InputError("Dask is not installed", expected="pip install 'poseppl[experiments]'") from error
    return distributed


class Tasks:
    """Jobs on their way through a scheduler.

    Args:
        client: Client of the scheduler, a `distributed.Client`.
        function: The function that computes a job.
        jobs: Jobs by key, the costliest first.
        max_deaths: Deaths of workers at which a job that is tried alone has failed.
    """

    def __init__(self, client: Any, function: Function, jobs: Mapping[str, Job], max_deaths: int = 1) -> None:
        self._client, self._function, self._jobs, self._max_deaths = client, function, jobs, max_deaths
        # tasks of one group wait at the scheduler, not at a worker that may die
        self._group = f"poseppl-{secrets.token_hex(4)}"
        self._futures: dict[Any, str] = {}
        self._deaths: Counter[str] = Counter()

    def outcomes(self, note: Note) -> Generator[Outcome]:
        """Compute the jobs; closing the iterator gives up those that are not done."""
        suspects = []
        try:
            for rank, key in enumerate(self._jobs):
                self._submit(key, -rank)
            for future in distributed().as_completed(list(self._futures), loop=self._client.loop):
                outcome = self._outcome(future)
                if outcome is not None:
                    yield outcome
                    continue
                suspects.append(self._futures[future])
                note(f"{suspects[-1]}: its process died; tried again on its own")
            for key in suspects:
                yield self._alone(key)
        finally:
            if self._client.status == "running":
                self._client.cancel(list(self._futures))

    def _submit(self, key: str, priority: int) -> Any:
        arguments = (_perform_there, key, self._function, self._jobs[key], versions())
        future = self._client.submit(*arguments, key=(self._group, key, self._deaths[key]), priority=priority)
        self._futures[future] = key
        return future

    def _alone(self, key: str) -> Outcome:
        while (outcome := self._outcome(self._submit(key, 0))) is None:
            if self._deaths[key] >= self._max_deaths:
                died = f"its process died {self._deaths[key]} times (killed, crashed or out of memory)"
                return Outcome(key, None, error=died)
        return outcome

    def _outcome(self, future: Any) -> Outcome | None:
        """Outcome of a job; None when its process died."""
        key = self._futures[future]
        try:
            outcome: Outcome = future.result()
        except distributed().KilledWorker as error:
            self._deaths[key] += error.allowed_failures + 1
            return None
        except Exception as error:
            if future.cancelled() or self._client.status != "running":
                hint = "finished jobs are kept, and the same call continues from there"
                raise PosepplError(f"the Dask scheduler at {self._client.scheduler.address} was lost; {hint}") from error
            return Outcome(key, None, error=f"{type(error).__name__}: {error}")
        return outcome


def _perform_there(key: str, function: Function, job: Job, wanted: Mapping[str, str]) -> Outcome:
    there = versions()
    differing = ", ".join(f"{name} {there[name]} instead of {wanted[name]}" for name in wanted if there[name] != wanted[name])
    if differing:
        return Outcome(key, None, error=f"its worker has {differing}")
    import dask

    with dask.config.set(scheduler="synchronous"):  # or what a job does with xarray would want locks of the scheduler
        return perform(key, function, job)


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
