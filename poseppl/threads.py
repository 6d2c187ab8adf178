"""Threads of JAX: more than there are cores, so that linear algebra in batches cannot wait for itself.

In jaxlib 0.10 a batch of LAPACK calls, such as the Cholesky factors of many particles, waits inside the very pool of threads
that is to compute it. If as many such batches wait at once as the pool has threads, they wait for ever: on two cores, two
are enough, such as the two halves of a matrix that a smoother of many points inverts. jaxlib takes the size of its pool from
the environment variable NPROC when it starts, and the number of cores without. Importing poseppl sets it, unless it is set.
"""

from __future__ import annotations

import os

_GIVEN = "NPROC" in os.environ
_SPARE = 8
"""Threads for the batches of a device that wait at once."""


def spare_threads(devices: int = 1) -> None:
    """Set NPROC, unless the environment came with it; has no effect once JAX has started.

    Args:
        devices: How many the CPU is made into.
    """
    if not _GIVEN:
        os.environ["NPROC"] = str((os.cpu_count() or 1) + _SPARE * (1 + devices))
