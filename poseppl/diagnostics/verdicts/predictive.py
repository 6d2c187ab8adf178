"""Whether the data come as the filter expected them, which needs no truth."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.predictive import PredictiveFigures, implied_coverage, predictive_figures
from poseppl.diagnostics.smoothing import fits_model
from poseppl.diagnostics.verdicts.verdict import ERROR, INFO, WARNING, Verdict
from poseppl.runs.contents import group_of
from poseppl.runs.predictive import Prediction
from poseppl.runs.results import provenance

INFLATION_HIGH = 1.4
"""Variance of errors over the claimed one, from which intervals are called too narrow: 90 % intervals cover 84 % then."""
CHANCE_LOW = 0.025
"""Chance of innovations as large as these, below which they are more than chance: one side of a 95 % interval."""
INFLATION_LOW = 0.5
OVER_CONFIDENT = "Over-confident: use more particles or chains or another filter, or widen the model's noise or transition."
BIAS_HIGH = 0.25
"""Share of the data beyond a half on one side of their predicted medians; steady motion under a random walk gives 0.2."""


def prediction(tree: xr.DataTree) -> list[Verdict]:
    """One-step-ahead predictions against the data that came; nothing where the result has none."""
    told = provenance(tree).get("predictive checks")
    if told is not None:
        return [Verdict(INFO, f"Predictive checks are {told}.")]
    checks = prediction_of(tree)
    found = [] if checks is None else check_predictions(checks)
    if "smoother" not in provenance(tree):
        return found
    # a smoother that is not bound to the filter's particles may be right where the filter is not
    let_be = fits_model(tree)
    return [Verdict(WARNING if let_be else each.severity, f"Of the filter that was smoothed: {each.text}") for each in found]


def prediction_of(tree: xr.DataTree) -> Prediction | None:
    """The predictive checks of a result, as many as it has; None where it has none."""
    data = group_of(tree, "predictive")
    return Prediction(**{name: data[name].values for name in Prediction._fields if name in data}) if data else None


def check_predictions(prediction: Prediction) -> list[Verdict]:
    """Judge the predictive checks of a run, `run.prediction` of :func:`poseppl.runs.run.run_filter`.

    Args:
        prediction: With a leading T.

    Returns:
        Findings; none where the predictions hold, or where there are too few frames to tell.
    """
    figures = predictive_figures(prediction)
    found, _, reach = figures.inflation
    if not np.isfinite(reach):
        return []
    beyond_chance = found - reach > 1 or figures.chance < CHANCE_LOW
    if found > INFLATION_HIGH and beyond_chance and _may_exceed(figures):
        share = implied_coverage(found)
        return [Verdict(ERROR, f"{_words(figures)}; 90 % intervals cover about {100 * share:.0f} %. {OVER_CONFIDENT}")]
    biased = abs(figures.high.estimate - 0.5) > BIAS_HIGH + figures.high.half_width
    if biased:
        side = "above" if figures.high.estimate > 0.5 else "below"
        share = max(figures.high.estimate, 1 - figures.high.estimate)
        return [
            Verdict(WARNING, f"{100 * share:.0f} % of the data came {side} the predicted median: the predictions are biased.")
        ]
    if found + reach < INFLATION_LOW:
        return [
            Verdict(
                WARNING, f"{_words(figures)}. Under-confident: the model's noise or transition is wider than the data need."
            )
        ]
    return []


def _may_exceed(figures: PredictiveFigures) -> bool:
    """Whether the innovations' sizes allow what their products say: smooth motion alone makes neighbours alike, too."""
    found, _, reach = figures.by_squares
    return not found + reach < INFLATION_HIGH


def _words(figures: PredictiveFigures) -> str:
    found, error, _ = figures.inflation
    outer = 100 * figures.outer.estimate
    return (
        f"The data say that errors of the predicted states have {found:.2g} ± {error:.1g} times the variance that the filter "
        f"claims ({outer:.0f} % of the data in the outer 10 % of their predictions)"
    )
