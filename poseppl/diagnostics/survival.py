"""Degeneracy of weighted particles: the effective number of samples, and how many ancestors a set of particles has left.

>>> float(effective_number(np.log([0.5, 0.5, 1e-30]))), int(unique_ancestors(np.array([0, 0, 2])))
(2.0, 2)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats, Integers


def effective_number(log_weights: ArrayLike) -> Floats:
    """Effective number of samples, one over the sum of the squared normalised weights (Choo and Fleet 2001, Eq. 6).

    Args:
        log_weights: (..., particle), normalised or not.

    Returns:
        (...), between 1 and the number of particles; NaN where every weight is zero or one of them is NaN.
    """
    values = np.asarray(log_weights, np.float64)
    top = values.max(axis=-1, keepdims=True)
    weights = np.exp(values - np.where(np.isfinite(top), top, 0.0))
    total = weights.sum(axis=-1)
    squares = np.square(weights).sum(axis=-1)
    valid = np.isfinite(top[..., 0])
    return np.where(valid, np.square(total) / np.where(valid, squares, 1.0), np.nan)


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
        ancestors: (frame, particle); row t holds the indices of the parents, at frame t - 1, of the particles of frame t. The
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
