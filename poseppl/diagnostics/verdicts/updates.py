"""Whether a filter's updates are what its own predictions and the data make, which needs no truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.updates import update_figures
from poseppl.diagnostics.verdicts.particles import suited_filter
from poseppl.diagnostics.verdicts.predictive import CHANCE_LOW, INFLATION_HIGH, prediction_of
from poseppl.diagnostics.verdicts.verdict import ERROR, Findings, Verdict, statistic
from poseppl.runs.predictive import Prediction
from poseppl.runs.results import provenance

LEAST_FRAMES = 10
"""Frames that have to tell."""


def updates(tree: xr.DataTree) -> Findings:
    """Updates that importance sampling contradicts; nothing where the result has no predictive checks of its state."""
    known, prediction, ess = provenance(tree), prediction_of(tree), statistic(tree, "ess")
    if prediction is None or prediction.memory is None or ess is None or "smoother" in known:
        return  # a smoother's posterior knows more than the prediction's data
    mean, deviation = (tree["summary"].dataset[f"state_{part}"].values for part in ("mean", "sd"))
    yield from check_updates(prediction, mean, deviation, ess, suited_filter(tree))


def check_updates(
    prediction: Prediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike, others: Sequence[str] = ()
) -> list[Verdict]:
    """Judge a filter's posteriors by its own predictions, weighted by the data's likelihood.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).
        others: Filters to turn to.

    Returns:
        A finding; none where they agree, or where there are too few frames to tell.
    """
    figures = update_figures(prediction, mean, standard_deviation, ess)
    if figures.frames < LEAST_FRAMES or not np.isfinite(figures.inflation).any():
        return []
    found = float(np.nanmean(figures.inflation))
    if not (found > INFLATION_HIGH and figures.chance < CHANCE_LOW):
        return []
    covered = np.mean([implied_coverage(each) for each in figures.inflation[np.isfinite(figures.inflation)]])
    advice = f"use another filter{''.join(f', such as {other}' for other in others)}, or linearise less often or otherwise"
    return [
        Verdict(
            ERROR,
            "The filter's posteriors are not what its own predictions and the data make, by importance sampling: errors add up "
            f"to {found:.2g} times the variance that it claims, and 90 % intervals cover about {100 * covered:.0f} % or less; "
            f"{advice}.",
        )
    ]
