"""Local processes that compute jobs, each on cores of its own.

A worker is a pool of one process, so that when it dies, killed by a user or for want of memory, it is known which job it was
at: that one is tried again in a fresh process, and no other job has lost anything. Processes are spawned, not forked, for JAX's
threads do not survive a fork; environment variables reach them, settings made in this process do not.

XLA uses all the cores that a process may run on. A worker is therefore pinned to its share of them before JAX starts there;
where the system cannot (macOS), workers compete. Each also watches a pipe from this process: when the pipe is closed, because
this process was interrupted or killed, the worker ends at once and leaves no orphan.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

from poseppl.checks import check_at_least
from poseppl.experiments.jobs.executor import Function, Note, Outcome, perform
from poseppl.experiments.jobs.job import Job

_CONTEXT = get_context("spawn")
Prepare = Callable[[], None]


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

    def outcomes(self, function: Function, jobs: Mapping[str, Job], note: Note) -> Iterator[Outcome]:
        """See :class:`~poseppl.experiments.jobs.executor.Executor`."""
        cores = available_cores()
        number = len(cores) if self.max_workers is None else self.max_workers
        check_at_least(1, max_workers=number, attempts=self.attempts)
        shares = core_shares(cores, min(number, len(jobs)))
        workers = [_Worker(share if self.pin else (), self.prepare) for share in shares]
        return _Round(function, jobs, note, self.attempts).outcomes(workers)


class _Round:
    """Jobs on their way through workers."""

    def __init__(self, function: Function, jobs: Mapping[str, Job], note: Note, attempts: int) -> None:
        self._function, self._jobs, self._note, self._attempts = function, jobs, note, attempts
        self._waiting = deque(jobs)
        self._deaths: Counter[str] = Counter()
        self._running: dict[Future[Outcome], tuple[str, _Worker]] = {}

    def outcomes(self, workers: Sequence[_Worker]) -> Iterator[Outcome]:
        try:
            for worker in workers:
                self._start(worker)
            while self._running:
                for future in wait(self._running, return_when=FIRST_COMPLETED).done:
                    key, worker = self._running.pop(future)
                    outcome = self._outcome(key, future, worker)
                    self._start(worker)
                    if outcome is not None:
                        yield outcome
        finally:
            for worker in workers:
                worker.stop()

    def _start(self, worker: _Worker) -> None:
        if self._waiting:
            key = self._waiting.popleft()
            self._running[worker.submit(key, self._function, self._jobs[key])] = key, worker

    def _outcome(self, key: str, future: Future[Outcome], worker: _Worker) -> Outcome | None:
        """What became of a job; None when it is to be tried again."""
        error = future.exception()
        if error is None:
            return future.result()
        if not isinstance(error, BrokenProcessPool):
            return Outcome(key, None, error=f"{type(error).__name__}: {error}")
        worker.stop()
        self._deaths[key] += 1
        if self._deaths[key] >= self._attempts:
            return Outcome(key, None, error=f"its process died {self._attempts} times (killed, crashed or out of memory)")
        self._note(f"{key}: its process died; tried again")
        self._waiting.append(key)
        return None


class _Worker:
    """A pool of one process, which is started with its first job and again after its death."""

    def __init__(self, cores: Sequence[int], prepare: Prepare | None) -> None:
        self._cores, self._prepare = cores, prepare
        self._pool: ProcessPoolExecutor | None = None
        self._pipe: tuple[Connection, Connection] | None = None

    def submit(self, key: str, function: Function, job: Job) -> Future[Outcome]:
        if self._pool is not None:
            with contextlib.suppress(BrokenProcessPool):
                return self._pool.submit(perform, key, function, job)
            self.stop()  # it died while it was idle
        self._pipe = _CONTEXT.Pipe(duplex=False)
        self._pool = ProcessPoolExecutor(1, _CONTEXT, _begin, (self._pipe[0], self._cores, self._prepare))
        return self._pool.submit(perform, key, function, job)

    def stop(self) -> None:
        """End the process now, whatever it does."""
        for end in self._pipe or ():
            end.close()
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._pipe = None


def available_cores() -> list[int]:
    """The cores that this process may run on."""
    if sys.platform == "linux":
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def core_shares(cores: Sequence[int], number: int) -> list[list[int]]:
    """Share cores among workers: each gets as many as any other, give or take one; more workers than cores take turns."""
    if number >= len(cores):
        return [[cores[index % len(cores)]] for index in range(number)]
    bounds = [index * len(cores) // number for index in range(number + 1)]
    return [list(cores[start:stop]) for start, stop in zip(bounds[:-1], bounds[1:], strict=True)]


def _begin(pipe: Connection, cores: Sequence[int], prepare: Prepare | None) -> None:
    """Set up a worker's process, before anything heavy is imported in it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    threading.Thread(target=_end_with_parent, args=(pipe,), daemon=True).start()
    if cores and sys.platform == "linux":
        for thread in Path("/proc/self/task").iterdir():
            with contextlib.suppress(OSError):
                os.sched_setaffinity(int(thread.name), cores)
    if prepare is not None:
        prepare()


def _end_with_parent(pipe: Connection) -> None:
    with contextlib.suppress(EOFError, OSError):
        pipe.recv_bytes()
    os._exit(1)
