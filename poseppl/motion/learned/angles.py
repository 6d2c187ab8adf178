"""Means and differences of angles, which are the same whole turns apart."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats


def wrapped(angles: Any) -> Any:
    """Angles within half a turn of zero, radians, of NumPy or JAX as they are given.

    >>> bool(abs(wrapped(np.float64(2 * np.pi + 0.1)) - 0.1) < 1e-12)
    True
    """
    return angles - 2 * np.pi * (angles / (2 * np.pi)).round()


def mean_angle(angles: ArrayLike, weights: Floats | None = None) -> Floats:
    """The direction of the mean of unit vectors, over the first axis, radians.

    It is corrected by the mean of the differences from it, so that the differences add up to nothing, as those from a mean do.

    Args:
        angles: (N, ...) radians.
        weights: (N,), which need not add up to 1; equal if None.
    """
    given = np.asarray(angles, np.float64)
    sine, cosine = (np.average(f(given), 0, weights) for f in (np.sin, np.cos))
    direction = np.arctan2(sine, cosine)
    return np.asarray(direction + np.average(wrapped(given - direction), 0, weights))
