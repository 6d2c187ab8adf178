"""Whether smoothed draws are draws of the model, and agree with the filter's, which needs no truth."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.diagnostics.batches import Interval
from poseppl.diagnostics.predictive import implied_coverage
from poseppl.diagnostics.smoothing import RESIDUAL_HIGH, STEPS_HIGH, exceeds, smoothing_figures
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Verdict, not_run
from poseppl.runs.results import provenance

STEPS_LOW = 0.5
APART_HIGH = 0.4
"""Distance of means beyond what variances allow, over the smoothed variance: 90 % intervals cover 84 % then."""
FAR = 1.0
"""From where smoothed means that lie too far are an error; nearer ones may be the filter's, or of wide intervals."""


def smoothing(tree: xr.DataTree) -> Findings:
    """Draws against the model, and moments against the filter's; nothing where the result is a filter's."""
    if "smoother" not in provenance(tree):
        yield not_run()
        return
    figures = smoothing_figures(tree)
    if not any(np.isfinite(figure.half_width) for figure in figures):
        yield not_run("no checks of the draws")
    wrong = "the model is wrong, or the smoother missed the posterior"
    if exceeds(figures.data, RESIDUAL_HIGH):
        yield Verdict(ERROR, f"Data lie {_times(figures.data)} as far from the smoothed states as their noise allows: {wrong}.")
    if exceeds(figures.steps, STEPS_HIGH):
        yield Verdict(ERROR, f"Smoothed states step {_times(figures.steps)} as far as the transition does: {wrong}.")
    elif figures.steps.estimate + figures.steps.half_width < STEPS_LOW:
        text = f"Smoothed states step only {_times(figures.steps)} as far as the transition does"
        yield Verdict(WARNING, f"{text}: draws that are too alike, or a transition that is wider than the data need.")
    apart, reach = figures.distance.estimate, figures.distance.half_width
    if np.isfinite(reach) and abs(apart) > max(APART_HIGH, reach):
        yield Verdict(WARNING if 0 < apart < FAR else ERROR, _disagreement(apart))


def _disagreement(apart: float) -> str:
    """Words on means that lie at another distance than variances allow."""
    by = f"than the variances of both allow, by {abs(apart):.2g} times the smoothed variance"
    if apart > 0:
        return (
            f"Smoothed means lie farther from the filtered ones {by}: they err by so much more than they claim, or smoothed "
            "intervals are too wide. Use more particles or draws, another smoother, or a better filter."
        )
    share = 100 * implied_coverage(1 - apart)
    return (
        f"Smoothed means lie nearer to the filtered ones {by}: smoothed intervals are too narrow, and of 90 % cover about "
        f"{share:.0f} %. Use more particles or draws, or another smoother."
    )


def _times(squares: Interval) -> str:
    """A ratio of squares as one of distances."""
    root = np.sqrt(max(squares.estimate, 0.0))
    return f"{root:.2g} ± {squares.standard_error / max(2 * root, 1e-9):.1g} times"
