"""Means over consecutive frames, which hang together: their standard errors by batches.

The frames are cut into about sqrt(frames) batches of consecutive ones, so that both the number and the length of the batches
grow with the sequence; the means of batches are taken as independent, and intervals are Student's with as many degrees of
freedom as there are batches, less one.

>>> ratio = log_ratio(np.full(9, 3.0), np.array([1.0, 1.1, 0.9] * 3))
>>> round(float(np.exp(ratio.estimate)), 2), ratio.half_width < 1e-12
(3.0, True)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from poseppl.arrays import Floats

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """An estimate, its standard error, and half the width of its central 95 % interval; NaN for those of a single frame."""

    estimate: float
    standard_error: float
    half_width: float


def num_batches(frames: int) -> int:
    """How many batches so many frames are cut into: sqrt(frames), and two where there are two or three frames."""
    return max(int(np.sqrt(frames)), min(2, frames))


def mean_interval(values: ArrayLike) -> Interval:
    """Estimate a mean over frames.

    Args:
        values: (frame, ...); those that are not finite are left out.
    """
    return ratio_interval(values, np.ones(np.shape(values)))


def ratio_interval(numerator: ArrayLike, denominator: ArrayLike) -> Interval:
    """Estimate a ratio of two means over the same frames.

    Args:
        numerator: a, (frame, ...), summed over what is behind the frames; entries that are not finite in both are left out.
        denominator: b, (frame, ...), of positive mean; else all is NaN.
    """
    a, b = np.broadcast_arrays(np.asarray(numerator, np.float64), np.asarray(denominator, np.float64))
    known, behind = np.isfinite(a) & np.isfinite(b), tuple(range(1, a.ndim))
    a, b = (np.where(known, part, 0.0).sum(axis=behind)[known.any(axis=behind)] for part in (a, b))
    if len(b) == 0 or b.sum() <= 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    estimate = a.mean() / b.mean()
    return Interval(float(estimate), *_error((a - estimate * b) / b.mean()))


def log_ratio(numerator: ArrayLike, denominator: ArrayLike) -> Interval:
    """Estimate the logarithm of a ratio of two means over the same frames, with the error of paired frames.

    By the delta method: log(mean a / mean b) errs as the mean of a / mean a - b / mean b does.

    Args:
        numerator: a, (frame,), all positive.
        denominator: b, (frame,), all positive.
    """
    a, b = np.asarray(numerator, np.float64), np.asarray(denominator, np.float64)
    error, reach = _error(a / a.mean() - b / b.mean())
    return Interval(float(np.log(a.mean() / b.mean())), error, reach)


def _error(residual: Floats) -> tuple[float, float]:
    """Standard error and half-width for the mean of residuals whose sum is zero."""
    number = num_batches(len(residual))
    if number < 2:
        return float("nan"), float("nan")
    sums = np.array([part.sum() for part in np.array_split(residual, number)])
    error = float(np.sqrt(number / (number - 1) * np.square(sums).sum()) / len(residual))
    return error, float(stdtrit(number - 1, (1 + CONFIDENCE) / 2)) * error
