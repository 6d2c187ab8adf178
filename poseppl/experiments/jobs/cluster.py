"""A Dask cluster that computes jobs, named by the address of its scheduler.

Each job is one task. When a worker is lost, the scheduler gives its tasks to another, and gives up tasks whose workers die time
and again (`distributed.scheduler.allowed-failures`, 3 unless the cluster is set up otherwise). It blames every task that the
worker held, so these jobs are tried once more when all others are done, one at a time: those that kill workers then fail.
Results travel to this process, which alone writes files, so no folder need be shared. Workers need poseppl, the job's module,
and the versions that are installed here; start them with one thread each (``dask worker ADDRESS --nthreads 1``).
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from poseppl.errors import InputError, PosepplError
from poseppl.experiments.jobs.archive import versions
from poseppl.experiments.jobs.executor import Function, Note, Outcome, perform
from poseppl.experiments.jobs.job import Job

_DIED = "its workers died, each time that it was tried (killed, crashed or out of memory)"


class Cluster(NamedTuple):
    """Computes jobs on a Dask cluster.

    Attributes:
        address: Of the scheduler, such as "tcp://host:8786".
        timeout: Seconds within which the scheduler must answer and have a worker.
    """

    address: str
    timeout: float = 10.0

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Iterator[Outcome]:
        """See :class:`~poseppl.experiments.jobs.executor.Executor`.

        Raises:
            InputError: Dask is not installed, no scheduler answers, or it has no workers.
            PosepplError: The scheduler was lost.
        """
        distributed = _import_distributed()
        client = self._connect(distributed)
        try:
            yield from _Session(distributed, client, function, jobs, self.address).outcomes(note)
        finally:
            client.close()

    def _connect(self, distributed: Any) -> Any:
        expected = "the address of a running Dask scheduler, such as tcp://host:8786"
        try:
            client = distributed.Client(self.address, timeout=self.timeout, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at {self.address}", expected=expected) from error
        try:
            client.wait_for_workers(1, timeout=self.timeout)
        except TimeoutError as error:
            client.close()
            raise InputError(f"the Dask scheduler at {self.address} has no workers", expected="at least one") from error
        return client


def _import_distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError("Dask is not installed", expected="pip install 'poseppl[cluster]'") from error
    return distributed


class _Session:
    """Jobs on their way through a scheduler."""

    def __init__(self, distributed: Any, client: Any, function: Function, jobs: Mapping[str, Job], address: str) -> None:
        self._distributed, self._client, self._address = distributed, client, address
        self._function, self._jobs = function, jobs
        # tasks of one group wait at the scheduler, not at a worker that may die
        self._group = f"poseppl-{secrets.token_hex(4)}"
        self._futures: dict[Any, str] = {}

    def outcomes(self, note: Note) -> Iterator[Outcome]:
        suspects = []
        try:
            for rank, key in enumerate(self._jobs):
                self._submit(key, "together", -rank)
            for future in self._distributed.as_completed(list(self._futures), loop=self._client.loop):
                key = self._futures.pop(future)
                outcome = self._outcome(future, key)
                if outcome is None:
                    note(f"{key}: its workers died; tried again on its own")
                    suspects.append(key)
                else:
                    yield outcome
            for key in suspects:
                future = self._submit(key, "alone", 0)
                yield self._outcome(future, key) or Outcome(key, None, error=_DIED)
                del self._futures[future]
        finally:
            if self._client.status == "running":
                self._client.cancel(list(self._futures))

    def _submit(self, key: str, how: str, priority: int) -> Any:
        arguments = (_perform_there, key, self._function, self._jobs[key], versions())
        future = self._client.submit(*arguments, key=(self._group, key, how), priority=priority)
        self._futures[future] = key
        return future

    def _outcome(self, future: Any, key: str) -> Outcome | None:
        """What became of a job; None when its workers died."""
        try:
            outcome: Outcome = future.result()
        except self._distributed.KilledWorker:
            return None
        except Exception as error:
            if future.cancelled() or self._client.status != "running":
                hint = "what is done is kept, and the same call goes on from there"
                raise PosepplError(f"the Dask scheduler at {self._address} was lost; {hint}") from error
            return Outcome(key, None, error=f"{type(error).__name__}: {error}")
        return outcome


def _perform_there(key: str, function: Function, job: Job, wanted: Mapping[str, str]) -> Outcome:
    there = versions()
    differing = ", ".join(f"{name} {there[name]} instead of {wanted[name]}" for name in wanted if there[name] != wanted[name])
    if differing:
        return Outcome(key, None, error=f"its worker has {differing}")
    return perform(key, function, job)
