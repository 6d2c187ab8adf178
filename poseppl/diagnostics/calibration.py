"""Whether a posterior is calibrated: coverage of its intervals, and ranks of the truth among its draws.

True values of neighbouring frames lie inside or outside of their intervals together, and so do those of one state. The standard
error of a coverage is therefore computed between sequences, or between batches of consecutive frames if there is one sequence.
It is never below the standard error of as many independent trials.

>>> inside = np.random.default_rng(0).random((400, 5)) < 0.9
>>> result = coverage(inside, 0.9)
>>> abs(result.estimate - 0.9) < 3 * result.standard_error < 0.05
True
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Booleans, Floats
from poseppl.diagnostics.batches import Interval, mean_interval, num_batches
from poseppl.diagnostics.inefficiency import array_stats
from poseppl.errors import InputError
from poseppl.runs.contents import flat_draws, group_of

LEVELS = (0.5, 0.8, 0.9)


class Coverage(NamedTuple):
    """Coverage of central intervals of a nominal ``level``: the share found, its standard error, and the number of trials."""

    level: float
    estimate: float
    standard_error: float
    trials: int


def inside_interval(draws: ArrayLike, truth: ArrayLike, level: float) -> Booleans:
    """Whether the truth lies in the central interval of the draws.

    Args:
        draws: (chain, draw, frame, ...).
        truth: (frame, ...).
        level: Nominal probability of the interval.

    Returns:
        (frame, ...).
    """
    interval = array_stats().eti(np.asarray(draws), level, axis=(0, 1))
    return between(interval[..., 0], interval[..., 1], truth)


def between(lower: ArrayLike, upper: ArrayLike, truth: ArrayLike) -> Booleans:
    """Whether the truth lies between two bounds, which belong to the interval.

    Args:
        lower: (frame, ...).
        upper: (frame, ...).
        truth: (frame, ...).

    Returns:
        (frame, ...).
    """
    values = np.asarray(truth)
    return np.asarray((np.asarray(lower) <= values) & (values <= np.asarray(upper)))


def coverage(inside: ArrayLike | Sequence[ArrayLike], level: float, *, valid: ArrayLike | None = None) -> Coverage:
    """Estimate a coverage and its standard error.

    Args:
        inside: (frame, ...) of one sequence, or a list of such arrays, one for each independent sequence.
        level: The nominal level.
        valid: For one sequence, the trials that count, (frame, ...).

    Returns:
        The coverage; NaN where no trial counts.
    """
    sequences = [np.asarray(part, float) for part in (inside if isinstance(inside, list | tuple) else [inside])]
    if valid is not None:
        sequences = [np.where(np.asarray(valid), sequences[0], np.nan)]
    batches = sequences if len(sequences) > 1 else np.array_split(sequences[0], num_batches(len(sequences[0])) or 1)
    hits, trials = np.array([(np.nansum(part), np.isfinite(part).sum()) for part in batches]).T
    count, number = int(trials.sum()), len(batches)
    if count == 0:
        return Coverage(level, float("nan"), float("nan"), 0)
    estimate = float(hits.sum() / count)
    # of a ratio of sums over independent batches
    error = np.sqrt(number / (number - 1) * np.square(hits - estimate * trials).sum()) / count if number > 1 else 0.0
    smoothed = (estimate * count + 1) / (count + 2)
    least = np.sqrt(smoothed * (1 - smoothed) / count)
    return Coverage(level, estimate, float(max(error, least)), count)


def reference_coverage(result: xr.DataTree, reference: xr.DataTree) -> Interval:
    """Share of a reference's draws in the 90 % intervals of a result, over frames and coordinates that are not known exactly.

    If the reference is right, such as a particle filter with many effective particles in few dimensions, this is the expected
    coverage for these data. It needs no truth. It shows what predictions of the data do not: an error in what the data hardly
    depend on, such as a distance by bearings or a sign.

    Args:
        result: A filter's result.
        reference: Another one's, of the same model and data.

    Returns:
        The share, its standard error by batches of frames; 0.9 is right.

    Raises:
        InputError: The results are of other frames or coordinates.
    """
    quantiles = group_of(result, "summary")["state_quantile"]
    low, high = (quantiles.sel(quantile=level, method="nearest").values for level in (0.05, 0.95))
    draws = flat_draws(reference).transpose("chain", "draw", "frame", "state_dim").values
    if draws.shape[2:] != low.shape:
        raise InputError(
            f"frames and coordinates {draws.shape[2:]}", field="reference", expected=f"those of the result, {low.shape}"
        )
    free = (high > low).any(0)
    return mean_interval(((low <= draws) & (draws <= high))[..., free].mean((0, 1, 3)))


def probability_transform(draws: ArrayLike, truth: ArrayLike) -> Floats:
    """Probability integral transform: the mid-rank of the truth among the draws, over their number plus one.

    Uniform where the posterior is calibrated; heaped at both ends where it is too narrow, in the middle where it is too wide.

    Args:
        draws: (chain, draw, frame, ...).
        truth: (frame, ...).

    Returns:
        (frame, ...) in (0, 1).
    """
    values = np.asarray(draws)
    return randomised_ranks(values.reshape(-1, *values.shape[2:]), truth, 0.5)


def randomised_ranks(draws: ArrayLike, truth: ArrayLike, ties: ArrayLike) -> Floats:
    """Ranks (...) in (0, 1) of the truth (...) among draws (L, ...); `ties` (...) are uniform in (0, 1) if randomised."""
    values, true = np.asarray(draws), np.asarray(truth)
    below, equal = (values < true).sum(axis=0), (values == true).sum(axis=0)
    return np.asarray((below + np.asarray(ties) * (equal + 1)) / (len(values) + 1))
