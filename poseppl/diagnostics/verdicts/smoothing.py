"""Whether smoothed draws are draws of the model, and agree with the filter's, which needs no truth."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.approximation import approximation_figures
from poseppl.diagnostics.batches import Interval
from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.smoothing import RESIDUAL_HIGH, STEPS_HIGH, exceeds, smoothing_figures
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Remedy, Verdict, not_run
from poseppl.runs.results import provenance

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
