"""Points of a detector that are somewhere else in the picture for a frame or two.

>>> steady = np.zeros((9, 1, 3, 2)) + np.arange(9)[:, None, None, None]
>>> steady[4, 0, 1] = 400.0
>>> np.argwhere(np.isnan(despike(steady, 50.0)).any(-1)).tolist()
[[4, 0, 1]]
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats

_LEAP = 10.0
"""A point leaps if it is this many times as far from the median as is usual."""
_REACH = 2
"""Frames before and after a point that its median is of."""


def despike(points: Floats, least: ArrayLike) -> Floats:
    """Points, NaN where one is far from the median of the five frames about it.

    Args:
        points: (T, C, K, 2), NaN where not seen.
        least: How far that is at least, px: one number, or (C,).
    """
    padded = np.pad(points, ((_REACH, _REACH), *((0, 0),) * 3), constant_values=np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # points that are never seen
        middle = np.nanmedian([padded[start : start + len(points)] for start in range(2 * _REACH + 1)], 0)
        away = np.linalg.norm(points - middle, axis=-1)
        usual = np.nanmedian(away, (0, 2))
    largest = np.fmax(_LEAP * usual, least)[:, None]
    return np.where((away <= largest)[..., None], points, np.nan)
