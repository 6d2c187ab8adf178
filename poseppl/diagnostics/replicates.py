"""Variance of the posterior mean against time, one point for each setting of a method.

Runs of one setting and of different seeds are replicates: the sample variance of their means, over the posterior variance, is
averaged over frames and degrees of freedom, with its jackknife error over seeds; of two seeds that error is sqrt(2) times the
variance, as if all frames went together. A setting with one seed has its own estimate, the average of 1 / ESS, with the error
of batches of frames: it does not know what the past of the filter adds, nor the bias of a run that misses part of the
posterior. The posterior variance is the median over all runs, the same for all points, so that a run whose posterior has
collapsed gains nothing by it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import mean_interval


class Spread(NamedTuple):
    """Variance of a mean over the posterior variance, and its standard error: each (state_dim,), or of all together."""

    variance: Floats
    standard_error: Floats


def variance_against_time(figures: xr.Dataset) -> xr.Dataset:
    """Compute the points of the settings.

    Args:
        figures: The figures of all runs, with a dimension ``run``.

    Returns:
        Over ``setting``, whose name is that of its first run: ``method``, ``replicates`` (seeds), ``seconds`` (a frame),
        ``seconds_se``, ``variance`` and ``variance_se``, and by ``state_dim`` ``variance_by_state_dim`` and
        ``variance_by_state_dim_se``.
    """
    reference = (figures["sd"] ** 2).median("run", skipna=False)
    groups = settings_of_runs(figures)
    points = [_point(figures.isel(run=group), reference.where(reference > 0)) for group in groups]
    return xr.concat(points, dim="setting").assign_coords(setting=[figures["run"].values[group[0]] for group in groups])


def _point(runs: xr.Dataset, reference: xr.DataArray) -> xr.Dataset:
    (total, total_error), (each, each_error) = _spread(runs, reference)
    seconds = runs["seconds"].values
    data = {
        "method": runs["method"].values[0],
        "replicates": len(seconds),
        "seconds": seconds.mean(),
        "seconds_se": seconds.std(ddof=1) / np.sqrt(len(seconds)) if len(seconds) > 1 else np.nan,
        "variance": total,
        "variance_se": total_error,
        "variance_by_state_dim": ("state_dim", each),
        "variance_by_state_dim_se": ("state_dim", each_error),
    }
    return xr.Dataset(data, coords={"state_dim": runs["state_dim"].values})


def settings_of_runs(figures: xr.Dataset) -> list[list[int]]:
    """Indices of the runs of each setting; a run without a known setting is a group of its own, and a seed counts once."""
    found: dict[str, dict[str, int]] = {}
    for index, (setting, seed) in enumerate(zip(figures["setting"].values, figures["seed"].values, strict=True)):
        known = str(setting) != "{}" and str(seed)
        found.setdefault(str(setting) if known else f"run {index}", {}).setdefault(str(seed), index)
    return [list(seeds.values()) for seeds in found.values()]


def _spread(runs: xr.Dataset, reference: xr.DataArray) -> tuple[Spread, Spread]:
    """Variance of all degrees of freedom together, and of each."""
    if runs.sizes["run"] > 1:
        squares = (runs["mean"] - runs["mean"].mean("run", skipna=False)) ** 2 / reference
        return _between(squares.mean(("frame", "state_dim")).values), _between(squares.mean("frame").values)
    inverse = 1 / runs["ess"].isel(run=0)
    each = np.array([mean_interval(inverse.isel(state_dim=state_dim))[:2] for state_dim in range(inverse.sizes["state_dim"])]).T
    return Spread(*np.array(mean_interval(inverse.mean("state_dim"))[:2])), Spread(*each)


def _between(squares: Floats) -> Spread:
    """From squared distances from the mean over seeds (seed, ...): the sample variance, and its jackknife error over seeds.

    Leaving seed s out of S leaves a sum of squares less by S / (S - 1) of its own.
    """
    count = len(squares)
    variance = np.asarray(squares.sum(axis=0) / (count - 1))
    if count == 2:
        return Spread(variance, np.sqrt(2.0) * variance)
    left = (squares.sum(axis=0) - squares * count / (count - 1)) / (count - 2)
    return Spread(variance, np.sqrt((count - 1) / count * np.square(left - left.mean(axis=0)).sum(axis=0)))
