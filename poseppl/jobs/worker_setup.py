"""Sets up a local worker's process before anything heavy is imported in it; needs Dask."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from distributed import WorkerPlugin


class WorkerSetup(WorkerPlugin):
    """Keeps a worker to its share of the cores, then prepares it.

    Args:
        shares: Cores of each worker, in the order of their names 0, 1, ...; empty leaves them all to all.
        prepare: Called once in each worker; None for nothing.
    """

    def __init__(self, shares: Sequence[Sequence[int]], prepare: Callable[[], None] | None) -> None:
        self._shares, self._prepare = shares, prepare

    def setup(self, worker: Any) -> None:
        """Called by Dask as a worker starts."""
        if self._shares and sys.platform == "linux":
            for thread in Path("/proc/self/task").iterdir():
                with suppress(OSError):
                    os.sched_setaffinity(int(thread.name), self._shares[worker.name])
        if self._prepare is not None:
            self._prepare()
