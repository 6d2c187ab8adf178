"""Whether a filter's updates and smoothed draws agree with the model, the filter and the data, which needs no truth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.diagnostics.batches import Interval
from poseppl.diagnostics.predictive import implied_coverage, update_coverage, update_figures
from poseppl.diagnostics.smoothing import RESIDUAL_HIGH, STEPS_HIGH, approximation_figures, exceeds, smoothing_figures
from poseppl.diagnostics.verdicts.particles import suited_filter
from poseppl.diagnostics.verdicts.predictive import CHANCE_LOW, INFLATION_HIGH, UNCHECKED, predicted_state_of
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Remedy, Verdict, not_run, statistic
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


STEPS_LOW = 0.5
APART_HIGH = 0.4
"""Distance of means beyond what variances allow, over the smoothed variance: 90 % intervals cover 84 % then."""
FAR = 1.0
"""From where smoothed means that lie too far are an error; nearer ones may be the filter's, or of wide intervals."""

_NATS = 1.0
"""Rise of the bound that is worth more steps."""


def smoothing(tree: xr.DataTree) -> Findings:
    """Draws against the model, and moments against the filter's; nothing where the result is a filter's."""
    if "smoother" not in provenance(tree):
        yield not_run()
        return
    yield from _approximation(tree)
    figures = smoothing_figures(tree)
    if not any(np.isfinite(figure.half_width) for figure in figures):
        yield not_run("no checks of the draws")
    wrong = "The model is wrong, or the smoother misses the posterior"
    if exceeds(figures.data, RESIDUAL_HIGH):
        text = f"The data are {_times(figures.data)} as far from the smoothed states as their noise allows"
        yield Verdict(ERROR, f"{text}. {wrong}.")
    if exceeds(figures.steps, STEPS_HIGH):
        yield Verdict(ERROR, f"Steps of the smoothed states are {_times(figures.steps)} as large as the transition's. {wrong}.")
    elif figures.steps.estimate + figures.steps.half_width < STEPS_LOW:
        text = f"Steps of the smoothed states are only {_times(figures.steps)} as large as the transition's"
        yield Verdict(WARNING, f"{text}. The draws are too similar, or the transition noise is too large for these data.")
    apart, reach = figures.distance.estimate, figures.distance.half_width
    if np.isfinite(reach) and abs(apart) > max(APART_HIGH, reach):
        yield Verdict(WARNING if 0 < apart < FAR else ERROR, _disagreement(apart, formulas=_of_formulas(tree)))


def _approximation(tree: xr.DataTree) -> Findings:
    """A fitted distribution that does not reach the posterior, or whose fit was not at its end."""
    figures = approximation_figures(tree)
    if figures is None:
        return
    if not figures.pareto_k <= figures.threshold:
        far = f"Pareto k of the trajectories is {figures.pareto_k:.2g}, above {figures.threshold:.2g}"
        text = (
            f"{far}: the approximation of the smoother is far from the posterior. Do not rely on its intervals; check them with"
        )
        yield Verdict(WARNING if figures.pareto_k < 1 else ERROR, f"{text} the trajectory or the particle-gibbs smoother.")
    if figures.rise > max(_NATS, 3 * figures.rise_error):
        text = f"The bound of the evidence rose by {figures.rise:.2g} nats in the second half of the fit: it had not converged;"
        yield Verdict(WARNING, text, (Remedy("increase {}", "num_steps", setting=True),))


def _of_formulas(tree: xr.DataTree) -> bool:
    """Whether filter and smoother are closed forms, in which no draw can be to blame."""
    known = provenance(tree)
    return bool(known.get("closed form") and known.get("filter closed form"))


def _disagreement(apart: float, *, formulas: bool) -> str:
    """Words on means that differ more or less than their variances allow."""
    by = f"than their variances allow ({'excess' if apart > 0 else 'deficit'} {abs(apart):.2g} times the smoothed variance)"
    text = f"Smoothed and filtered means differ {'more' if apart > 0 else 'less'} {by}"
    if formulas:
        return (
            f"{text}. Both are closed forms, without Monte Carlo error: the model does not describe the data (noise, "
            "transition), or is too far from linear for these formulas."
        )
    if apart > 0:
        return (
            f"{text}: the means have larger errors than the intervals say, or the smoothed intervals are too wide. Use more "
            "particles or draws, another smoother, or another filter."
        )
    share = 100 * implied_coverage(1 - apart)
    return (
        f"{text}: the smoothed intervals are too narrow, and the coverage of 90 % intervals is about {share:.0f} %. Use more "
        "particles or draws, or another smoother."
    )


def _times(squares: Interval) -> str:
    """A ratio of squares as one of distances."""
    root = np.sqrt(max(squares.estimate, 0.0))
    return f"{root:.2g} ± {squares.standard_error / max(2 * root, 1e-9):.1g} times"
