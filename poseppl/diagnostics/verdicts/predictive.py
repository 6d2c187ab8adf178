"""Whether the data agree with the filter's predictions, and its errors by these predictions, without a truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.diagnostics.predictive import PredictiveFigures, farthest_stretch, implied_coverage, predictive_figures
from poseppl.diagnostics.smoothing import fits_model
from poseppl.diagnostics.unreached import finite_sample_inflation, weakly_observed_stats
from poseppl.diagnostics.verdicts.coverage import Calibration, calibration
from poseppl.diagnostics.verdicts.particles import suited_filter
from poseppl.diagnostics.verdicts.verdict import (
    ERROR,
    INFO,
    WARNING,
    Findings,
    Verdict,
    not_run,
    settings_among,
    statistic,
)
from poseppl.runs.contents import flat_draws, group_of, names_of
from poseppl.runs.predictive import DataPrediction, Prediction, StatePrediction
from poseppl.runs.results import provenance

INFLATION_HIGH = 1.4
"""Variance of errors over the claimed one, from which intervals are called too narrow: 90 % intervals cover 84 % then."""
CHANCE_LOW = 0.025
"""Chance of innovations as large as these, below which they are more than chance: one side of a 95 % interval."""
INFLATION_LOW = 0.5
OVER_CONFIDENT = (
    "Overconfident: use more particles or chains, another filter, or a larger noise or transition variance in the model."
)
UNDER_CONFIDENT = "Underconfident predictions"
OUTER_LOW = 0.02
"""Share of the data in the outer 10 % of their predictions, below which these are too wide."""
NOT_OF_STATES = "This is about the data, not about the states."
BIAS_HIGH = 0.25
"""Share of the data beyond a half on one side of their predicted medians; steady motion under a random walk gives 0.2."""
MAX_NAMED = 4
UNCHECKED = "no predictive checks"
_SHAPES: dict[Calibration, str] = {
    "over-confident": "overconfident, with higher bars at both ends",
    "under-confident": "underconfident, with a hump in the middle",
    "calibrated": "calibrated, with equal bars within their errors",
    "undecided": "compatible with 90 %, but the sequence is too short to decide",
}
NOT_CHECKED = "infer(..., predict=poseppl.predictive_checks(model))"


def prediction(tree: xr.DataTree) -> Findings:
    """One-step-ahead predictions against the data that came; nothing where the result has none."""
    known, checks = provenance(tree), prediction_of(tree)
    if known.get("predictive checks") is not None:
        yield not_run("unsuitable")
        yield Verdict(INFO, f"Predictive checks are {known['predictive checks']}.")
    elif checks is None:
        yield not_run(UNCHECKED)
        if "smoother" not in known and statistic(tree, "log_evidence") is not None:
            yield Verdict(INFO, f"The filter's predictions were not checked. To check them: {NOT_CHECKED}.")
    else:
        yield from _of_checks(tree, checks)


def _of_checks(tree: xr.DataTree, checks: Prediction) -> Findings:
    found = check_predictions(checks.data, group_of(tree, "predictive")["frame"].values)
    if "smoother" not in provenance(tree):
        yield from found
        return
    # a smoother that is not bound to the filter's particles may be right where the filter is not
    for each in found:
        severity = WARNING if each.severity == ERROR and fits_model(tree) else each.severity
        yield each._replace(severity=severity, finding=f"Filter before smoothing: {each.finding}")


def rank_test(tree: xr.DataTree) -> str:
    """Describe the data's ranks among their predictions, by the coverage of prediction intervals; none without such checks."""
    checks = prediction_of(tree)
    if checks is None:
        return ""
    figures = predictive_figures(checks.data)
    share, reach = 1 - figures.outer.estimate, figures.outer.half_width
    if not np.isfinite(reach):
        return "There are too few frames to judge the shape."
    text = f"The coverage of 90 % prediction intervals is {100 * share:.0f} % (± {100 * figures.outer.standard_error:.0f})"
    return " ".join([f"{text}: {_SHAPES[calibration(share, reach / 2)]}.", *(each.text for each in _bias(figures))])


def prediction_of(tree: xr.DataTree) -> Prediction | None:
    """The predictive checks of a result, as many as it has; None where it has none."""
    data = group_of(tree, "predictive")
    return Prediction.of({str(name): values.values for name, values in data.items()}) if data else None


def predicted_state_of(tree: xr.DataTree) -> StatePrediction | None:
    """A filter's predictions of its state; None where that was not kept, and of a smoother, which knows more data."""
    checks = prediction_of(tree)
    return None if checks is None or "smoother" in provenance(tree) else checks.state


def check_predictions(prediction: DataPrediction, frames: ArrayLike | None = None) -> list[Verdict]:
    """Judge the predictive checks of a run, `run.prediction.data` of :func:`poseppl.runs.run.run_filter`.

    Args:
        prediction: With a leading T.
        frames: Frame numbers (T,); 0, 1, ... if None.

    Returns:
        Findings; none if the predictions are right, or if there are too few frames to decide.
    """
    figures = predictive_figures(prediction)
    found, _, reach = figures.inflation
    if not np.isfinite(reach):
        return []
    beyond_chance = found - reach > 1 or figures.chance < CHANCE_LOW
    squares = figures.by_squares  # the innovations' sizes may not allow it: smooth motion alone makes neighbours alike, too
    if found > INFLATION_HIGH and beyond_chance and not squares.estimate + squares.half_width < INFLATION_HIGH:
        share = implied_coverage(found)
        return [
            Verdict(ERROR, f"{_words(figures)}; the coverage of 90 % intervals is about {100 * share:.0f} %. {OVER_CONFIDENT}")
        ]
    if figures.by_chi_square.estimate > INFLATION_HIGH and figures.chance < CHANCE_LOW:
        return [Verdict(ERROR, _of_whole_frames(figures, prediction, frames))]
    return _bias(figures) or _too_wide(figures)


def _bias(figures: PredictiveFigures) -> list[Verdict]:
    """Data that are nearly always on one side of their predicted median."""
    high = figures.high
    if not abs(high.estimate - 0.5) > BIAS_HIGH + high.half_width:
        return []
    side, share = ("above", high.estimate) if high.estimate > 0.5 else ("below", 1 - high.estimate)
    return [Verdict(WARNING, f"{100 * share:.0f} % of the data are {side} the predicted median: the predictions are biased.")]


def _too_wide(figures: PredictiveFigures) -> list[Verdict]:
    """Predictions of the data that are wider than these need; of autocorrelated errors the states' intervals may be right."""
    found, _, reach = figures.inflation
    products, outer = figures.by_products, figures.outer.estimate
    alike, unlike = products.estimate - products.half_width > 1, products.estimate + products.half_width < 1
    nearly_all = outer < OUTER_LOW and figures.chance_low < CHANCE_LOW
    if not nearly_all and not found + reach < INFLATION_LOW:
        return []
    if alike:
        cause = "The noise is too large, or errors are autocorrelated (the motion is steadier than the transition)"
    else:
        cause = f"The transition variance {'is' if unlike else 'and the noise are'} too large"
    severity = INFO if (alike or unlike) and not nearly_all else WARNING
    text = f"{UNDER_CONFIDENT}: the coverage of 90 % intervals of the data, one frame ahead, is {100 * (1 - outer):.0f} %"
    return [Verdict(severity, f"{text}. {cause}. {NOT_OF_STATES}")]


def _words(figures: PredictiveFigures) -> str:
    found, error, _ = figures.inflation
    outer = 100 * figures.outer.estimate
    return (
        f"The data say that errors of the predicted states have {found:.2g} ± {error:.1g} times the variance that the filter "
        f"reports ({outer:.0f} % of the data are in the outer 10 % of their predictions)"
    )


def _of_whole_frames(figures: PredictiveFigures, prediction: DataPrediction, frames: ArrayLike | None) -> str:
    numbers = np.arange(len(prediction.chi_square)) if frames is None else np.asarray(frames)
    first, last = (numbers[at] for at in farthest_stretch(prediction))
    found, error, _ = figures.by_chi_square
    return (
        f"The data say of whole frames that errors of the predicted states have {found:.2g} ± {error:.1g} times the variance "
        f"that the filter reports, mostly in frames {first} to {last} (p = {figures.chance:.1g}): it may follow a wrong "
        f"mode. {OVER_CONFIDENT}"
    )


def few_points(tree: xr.DataTree) -> Findings:
    """Errors that the number of points alone explains, for filters that report it and results with predictive checks."""
    known, prediction = provenance(tree), predicted_state_of(tree)
    points = known.get("points of the past")
    if points is None or prediction is None:
        yield not_run(UNCHECKED if points is not None and "smoother" not in known else "")
        return
    draws = np.concatenate(flat_draws(tree).values)  # of all chains
    found = finite_sample_inflation(prediction, tree["summary"].dataset["state_sd"].values, points, draws)
    shares = [implied_coverage(each) for each in found[np.isfinite(found)]]
    if shares and np.mean(shares) < implied_coverage(INFLATION_HIGH):
        yield Verdict(
            ERROR,
            f"{points} points carry the past from frame to frame: by their Monte Carlo error alone, the coverage of 90 % "
            f"intervals is at most about {100 * np.mean(shares):.0f} %;",
            (*settings_among(tree, "num_chains"), *suited_filter(tree)),
        )


def unreached(tree: xr.DataTree) -> Findings:
    """Weakly informed coordinates; nothing where the result has no predictive checks of its state."""
    prediction, ess = predicted_state_of(tree), statistic(tree, "ess")
    if prediction is None or ess is None:
        yield not_run("" if "smoother" in provenance(tree) else UNCHECKED)
        return
    mean, deviation = (tree["summary"].dataset[f"state_{part}"].values for part in ("mean", "sd"))
    yield from check_unreached(prediction, mean, deviation, ess, names_of(tree, "state_dim"))


def check_unreached(
    prediction: StatePrediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike, names: Sequence[str]
) -> list[Verdict]:
    """Judge a filter in weakly informed coordinates.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).
        names: Names of the coordinates (d,).

    Returns:
        A finding; none if the posterior is what the prediction allows, or if there are too few frames to decide.
    """
    figures = weakly_observed_stats(prediction, mean, standard_deviation, ess)
    if figures is None:
        return []
    found, error, reach = figures.inflation
    if not (np.isfinite(reach) and found > INFLATION_HIGH and found - reach > 1):
        return []
    which = np.flatnonzero(figures.coordinates)
    more = f" and {len(which) - MAX_NAMED} more" if len(which) > MAX_NAMED else ""
    return [
        Verdict(
            ERROR,
            f"In weakly informed coordinates ({', '.join(names[i] for i in which[:MAX_NAMED])}{more}), errors have "
            f"{found:.2g} ± {error:.1g} times the variance that the filter reports: the variance shrinks by "
            f"{100 * figures.lost:.0f} % a frame, and data explain {max(0.0, 100 * figures.explained):.0f} %; the coverage of "
            f"90 % intervals is about {100 * implied_coverage(found):.0f} %. {OVER_CONFIDENT}",
        )
    ]
