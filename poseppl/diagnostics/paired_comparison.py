"""Which run does best where, and whether the difference is more than chance.

Each quantity is a loss, positive and averaged over the frames, the smaller the better: ``ess_per_second`` is judged by
seconds / ESS and ``ess_per_evaluation`` by evaluations / ESS, the cost of one effective draw (the variance of a mean is inverse
in ESS, so that its average is); ``error`` is the distance of a coordinate's mean from the truth. For all coordinates together
that is the mean joint error in mm; without markers the mean over coordinates of the error over that of all runs.

The run of the smallest mean loss is the best. Every other run is compared with it on the same frames
(:func:`poseppl.diagnostics.batches.log_ratio`): one whose ratio lies outside of its 95 % interval about 1 has lost; the others
are not worse. The best has won if it is alone; several are a tie. Runs without the statistic do not take part. A frame without
it for one of the other runs is left out for all. With fewer than two runs there is no comparison. The time of a run is one
measurement, whose own noise the frames do not show: for ``ess_per_second`` the interval is 10 % wider at each end. A single
frame decides nothing: all runs that take part in it tie. A run whose coverage of 90 % intervals is below 75 % by more than two
standard errors is left out of comparisons of ESS, because draws of a wrong posterior have no value.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Booleans, Floats
from poseppl.diagnostics.batches import log_ratio

QUANTITIES = {
    "ess_per_second": "highest ESS per second",
    "ess_per_evaluation": "highest ESS per evaluation",
    "error": "smallest error",
}
"""The quantities, and what the best run has."""
TIE = "tie"
MIN_COVERAGE = 0.75
"""Coverage of 90 % intervals below which a run is left out of comparisons of ESS."""
TIMING_NOISE = 0.1
"""Relative error of a time, by which the same run differs from one call to the next on a busy machine."""
_MIN_SHARE = 0.5
"""Share of the frames for which a run needs a figure, to take part."""


class PairedComparison(NamedTuple):
    """The outcome for one quantity.

    Attributes:
        not_worse: (run,) whether a run is not worse than the best.
        ratio: (run,) the loss of the best over that of each run: 1 for the best, below 1 for the others; NaN for runs that do
            not take part.
        low: (run,) lower end of its 95 % interval.
        high: (run,) upper end.
    """

    not_worse: Booleans
    ratio: Floats
    low: Floats
    high: Floats


def compare_losses(losses: Floats, noise: float = 0.0) -> PairedComparison:
    """Find the runs that are not worse than the best.

    Args:
        losses: (run, frame), positive; NaN where a run has none.
        noise: Relative error that all frames of a run share.

    Returns:
        The outcome; nobody is not worse where fewer than two runs take part.
    """
    count, frames = losses.shape
    finite = np.isfinite(losses) & (losses > 0)
    takes_part = finite.sum(axis=1) >= _MIN_SHARE * frames
    common = finite[takes_part].all(axis=0)
    outcome = PairedComparison(np.zeros(count, bool), *np.full((3, count), np.nan))
    if takes_part.sum() < 2 or not common.any():
        return outcome
    usable = losses[:, common]
    best = int(np.argmin(np.where(takes_part, usable.mean(axis=1), np.inf)))
    for run in np.flatnonzero(takes_part):
        found = log_ratio(usable[best], usable[run])
        reach = 0.0 if run == best else np.nan_to_num(found.half_width, nan=np.inf) + np.log1p(noise)
        ends = np.exp([found.estimate, found.estimate - reach, min(found.estimate + reach, 700.0)])
        outcome.ratio[run], outcome.low[run], outcome.high[run] = ends
        outcome.not_worse[run] = found.estimate + reach >= 0
    return outcome


def is_miscalibrated(coverage: Floats, standard_error: Floats) -> Booleans:
    """Whether 90 % intervals cover too little of the truth, (run,) each; False where the truth is not known."""
    return np.asarray(coverage + 2 * standard_error < MIN_COVERAGE)


def compare_quantities(figures: xr.Dataset, miscalibrated: xr.DataArray) -> tuple[xr.Dataset, xr.Dataset]:
    """Compare the runs by every quantity.

    Args:
        figures: The figures of all runs, with a dimension ``run``.
        miscalibrated: (run,) whether a run is left out of comparisons of ESS.

    Returns:
        Two datasets over ``quantity``, the first for all degrees of freedom together, the second for each ``state_dim``:
        ``winner`` (the name of a run, "tie", or empty without a comparison), and ``not_worse``, ``ratio``, ``ratio_low`` and
        ``ratio_high`` (quantity, ..., run) of :class:`PairedComparison`.
    """
    each = [_losses(figures, quantity).where(~miscalibrated | (quantity == "error")) for quantity in QUANTITIES]
    together = [_of_all(figures, quantity, losses) for quantity, losses in zip(QUANTITIES, each, strict=True)]
    return _outcomes(xr.concat(together, dim="quantity")), _outcomes(xr.concat(each, dim="quantity"))


def _losses(figures: xr.Dataset, quantity: str) -> xr.DataArray:
    values = figures[quantity].astype(np.float64)
    with np.errstate(divide="ignore"):
        return values if quantity == "error" else 1 / values


def _of_all(figures: xr.Dataset, quantity: str, losses: xr.DataArray) -> xr.DataArray:
    """Mean over the degrees of freedom that all models share and anyone has a figure for; the joint error in mm."""
    joint, shared = figures["joint_error"].astype(np.float64), figures["mean"].notnull().any("frame").all("run")
    free = (abs(losses) < np.inf).any(("run", "frame")) & shared
    if quantity == "error" and np.isfinite(joint).any():
        return joint
    if not free.any():
        return xr.full_like(joint, np.nan)
    if quantity == "error":
        losses = losses / losses.mean(("run", "frame"))
    return losses.isel(state_dim=free.values).mean("state_dim", skipna=False)


def _outcomes(losses: xr.DataArray) -> xr.Dataset:
    """Outcomes of losses (quantity, run, frame, ...) by field."""
    noise = xr.DataArray([TIMING_NOISE if quantity == "ess_per_second" else 0.0 for quantity in QUANTITIES], dims="quantity")
    cores: list[list[str]] = [["run", "frame"], []]
    fields = xr.apply_ufunc(
        compare_losses, losses, noise, input_core_dims=cores, output_core_dims=[["run"]] * 4, vectorize=True
    )
    data = xr.Dataset(dict(zip(("not_worse", "ratio", "ratio_low", "ratio_high"), fields, strict=True)))
    number, single = data["not_worse"].sum("run"), data["run"][data["not_worse"].argmax("run")].drop_vars("run")
    winner = single.where(number == 1, "").where(number <= 1, TIE).astype(str)
    return data.assign(winner=winner).assign_coords(quantity=list(QUANTITIES))
