"""Whether a filter's updates are what its own predictions and the data make, which needs no truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.updates import update_coverage, update_figures
from poseppl.diagnostics.verdicts.particles import suited_filter
from poseppl.diagnostics.verdicts.predictive import CHANCE_LOW, INFLATION_HIGH, UNCHECKED, predicted_state_of
from poseppl.diagnostics.verdicts.verdict import ERROR, Findings, Remedy, Verdict, not_run, statistic
from poseppl.runs.predictive import StatePrediction
from poseppl.runs.results import provenance

MIN_FRAMES = 10
"""The least number of frames that are used."""
COVERAGE_LOW = 0.85
"""Share of a frame's posterior in 90 % intervals, from which they are called too narrow."""
_NOMINAL = 0.9


def updates(tree: xr.DataTree) -> Findings:
    """Updates that importance sampling contradicts; nothing where the result has no predictive checks of its state."""
    prediction, ess = predicted_state_of(tree), statistic(tree, "ess")
    if prediction is None or prediction.memory is None or ess is None:
        yield not_run(UNCHECKED if prediction is None and "smoother" not in provenance(tree) else "")
        return
    summary, others = tree["summary"].dataset, [str(each.value) for each in suited_filter(tree)]
    found = check_updates(prediction, summary["state_mean"].values, summary["state_sd"].values, ess, others)
    if not found and {0.05, 0.95} <= set(summary.get("quantile", xr.DataArray([])).values.tolist()):
        low, high = (summary["state_quantile"].sel(quantile=level).values for level in (0.05, 0.95))
        found = check_intervals(prediction, low, high, others)
    yield from found


def check_updates(
    prediction: StatePrediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike, others: Sequence[str] = ()
) -> list[Verdict]:
    """Judge a filter's posteriors by its own predictions, weighted by the data's likelihood.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).
        others: Filters to turn to, by name.

    Returns:
        A finding; none if they agree, or if there are too few frames to decide.
    """
    figures = update_figures(prediction, mean, standard_deviation, ess)
    if figures.frames < MIN_FRAMES or not np.isfinite(figures.inflation).any():
        return []
    found = float(np.nanmean(figures.inflation))
    least = figures.over_frames.estimate - 2 * figures.over_frames.standard_error
    if not (found > INFLATION_HIGH and figures.chance < CHANCE_LOW and least > 1):
        return []
    covered = np.mean([implied_coverage(each) for each in figures.inflation[np.isfinite(figures.inflation)]])
    return [
        Verdict(
            ERROR,
            f"{_CONTRADICTED}: errors have {found:.2g} times the variance that it reports, and the coverage of 90 % intervals "
            f"is about {100 * covered:.0f} % or less;",
            (*_other(others), Remedy("use another linearisation")),
        )
    ]


def check_intervals(prediction: StatePrediction, low: ArrayLike, high: ArrayLike, others: Sequence[str] = ()) -> list[Verdict]:
    """Judge a filter's 90 % intervals by its own predictions, weighted by the data's likelihood.

    Args:
        prediction: With a leading T.
        low: Their lower ends (T, d).
        high: Their upper ends (T, d).
        others: Filters to turn to, by name.

    Returns:
        A finding; none if they agree, or if there are too few frames to decide.
    """
    frames, (covered, error, reach) = update_coverage(prediction, low, high)
    if not (frames >= MIN_FRAMES and covered < COVERAGE_LOW and covered + reach < _NOMINAL):
        return []
    return [
        Verdict(
            ERROR,
            f"{_CONTRADICTED}: the coverage of its 90 % intervals is {100 * covered:.0f} ± {100 * error:.0f} %, as for "
            "posteriors with several modes or skewness;",
            _other(others),
        )
    ]


_CONTRADICTED = "The filter's posteriors contradict its own predictions and the data, by importance sampling"


def _other(names: Sequence[str]) -> tuple[Remedy, ...]:
    return tuple(Remedy("use another filter, such as {}", "filter", name) for name in names) or (Remedy("use another filter"),)
