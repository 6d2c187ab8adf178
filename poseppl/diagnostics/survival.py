"""How many ancestors a set of particles has left.

>>> int(unique_ancestors(np.array([0, 0, 2])))
2
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Integers


def unique_ancestors(ancestors: ArrayLike) -> Integers:
    """Number of particles of the previous frame that have a descendant in this one.

    Args:
        ancestors: (..., particle) indices into the particles of the previous frame.

    Returns:
        (...).
    """
    ordered = np.sort(np.asarray(ancestors), axis=-1)
    return np.asarray(1 + (np.diff(ordered, axis=-1) != 0).sum(axis=-1), dtype=np.int64)


def survival(ancestors: ArrayLike) -> Integers:
    """Number of particles of each frame that have a descendant in the last one.

    Args:
        ancestors: (frame, particle); row t has the indices of the parents, at frame t - 1, of the particles of frame t. The
            first row is not used.

    Returns:
        (frame,); the last entry is the number of particles.
    """
    table = np.asarray(ancestors)
    alive = np.arange(table.shape[1])
    counts = np.empty(len(table), np.int64)
    for frame in range(len(table) - 1, -1, -1):
        counts[frame] = len(alive)
        alive = np.unique(table[frame][alive])
    return counts
