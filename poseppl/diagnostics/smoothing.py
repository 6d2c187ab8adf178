"""Figures of a smoothed result without a truth: draws against the model, moments against the filter's, Pareto's k of a fit.

If smoother and model are right, squared residuals of the data and squared steps of the draws average to what the model expects
(:mod:`poseppl.runs.posterior_checks`). If smoother and filter are right, means m and variances P obey

    E[(m_s - m_f)^2] = P_f - P_s

(law of total variance, given the data that the filter knew), whatever their distributions. D = sum (m_s - m_f)^2 - (P_f - P_s)
should be 0. If D is not 0, the smoothed means have larger errors than reported, or the smoothed variance is smaller than the
later data allow. Coordinates are weighted by their filtered variance. The contribution of the Monte Carlo errors of both means
is subtracted from D.

With r_i = p(x_i, z) / q(x_i) of N trajectories x_i ~ q, the largest ratios follow a generalised Pareto distribution of shape k
(Vehtari, Simpson, Gelman, Yao and Gabry 2024, https://jmlr.org/papers/v25/19-556.html). Above min(1 - 1 / log10 N, 0.7) the
posterior has mass that q does not reach (Yao et al. 2018, arXiv:1802.02538, of variational fits). The ratios are those of whole
trajectories: k judges all frames jointly, and is stricter than a single frame's interval needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import Interval, ratio_interval
from poseppl.diagnostics.inefficiency import array_stats
from poseppl.runs.contents import variable
from poseppl.runs.posterior_checks import GROUP
from poseppl.runs.results import provenance

RESIDUAL_HIGH = 1.2
"""Squared residuals of the data over what is expected, from which they are wrong; most of them is noise, not error."""
STEPS_HIGH = 1.4
"""Squared steps over what is expected, from which they are wrong."""
MIN_FRAMES = 12
"""Frames from which the distance of means is judged: in fewer, rare large changes make its interval too narrow."""
UNKNOWN = Interval(float("nan"), float("nan"), float("nan"))


class SmoothingFigures(NamedTuple):
    """Figures of a sequence; NaN if the result does not contain it.

    Attributes:
        data: Squared residuals of the data over what the draws expect; 1 is right.
        steps: Squared steps of the draws over what the transition expects; 1 is right.
        distance: D over the smoothed variance; 0 is right, 1 is as much again.
    """

    data: Interval
    steps: Interval
    distance: Interval


def smoothing_figures(tree: xr.DataTree) -> SmoothingFigures:
    """Sum the checks of a smoothed result up."""
    return SmoothingFigures(_data(tree), _steps(tree), _distance(tree))


def exceeds(ratio: Interval, bound: float) -> bool:
    """Whether a ratio is above a bound, and above 1 by its interval."""
    return bool(np.isfinite(ratio.half_width) and ratio.estimate > bound and ratio.estimate - ratio.half_width > 1)


def fits_model(tree: xr.DataTree) -> bool:
    """Whether smoothed trajectories are known to be draws of the model: data and steps are both as expected."""
    figures = smoothing_figures(tree)
    known = np.isfinite(figures.data.half_width) and np.isfinite(figures.steps.half_width)
    return bool(known) and not (exceeds(figures.data, RESIDUAL_HIGH) or exceeds(figures.steps, STEPS_HIGH))


def _data(tree: xr.DataTree) -> Interval:
    square, seen = (variable(tree, GROUP, name) for name in ("data_square", "data_seen"))
    return UNKNOWN if square is None or seen is None else ratio_interval(square * seen, np.where(seen > 0, seen, np.nan))


def _steps(tree: xr.DataTree) -> Interval:
    square, expected = (variable(tree, GROUP, f"step_{name}") for name in ("square", "expected"))
    if square is None or expected is None:
        return UNKNOWN
    ratio = _weighed(square[1:], expected[1:], expected[1:].mean(axis=0))
    # half of both squares is that of the draw of the transition that they share
    doubled = ratio._replace(standard_error=2 * ratio.standard_error, half_width=2 * ratio.half_width)
    return doubled._replace(estimate=2 * ratio.estimate - 1)


def _distance(tree: xr.DataTree) -> Interval:
    if provenance(tree).get("model of the filter") is False:
        return UNKNOWN  # the law of total variance is of one model
    before, spread_before, draws_before = (variable(tree, "filtered", name) for name in ("state_mean", "state_sd", "ess"))
    mean, spread = (variable(tree, "summary", f"state_{name}") for name in ("mean", "sd"))
    draws = variable(tree, "sample_stats", "ess")
    if before is None or spread_before is None or mean is None or spread is None or len(mean) < MIN_FRAMES:
        return UNKNOWN
    variance_before, variance = np.square(spread_before, dtype=float), np.square(spread, dtype=float)
    error = variance_before / _effective(draws_before) + variance / _effective(draws)
    distance = np.square(mean - before, dtype=float) - (variance_before - variance) - error
    # in the last frame both know the same
    return _weighed(distance[:-1], variance[:-1], variance_before.mean(axis=0))


def _effective(draws: Floats | None) -> Floats:
    """Effective numbers (T, 1), infinite if they are unknown."""
    if draws is None:
        return np.full((1, 1), np.inf)
    numbers: Floats = np.maximum(np.nan_to_num(np.asarray(draws, np.float64), nan=np.inf), 1.0)
    return numbers[:, None]


def _weighed(numerator: Floats, denominator: Floats, scale: Floats) -> Interval:
    """Sum over sum of (frame, state_dim), each coordinate in units of its scale (state_dim,); those without are left out."""
    free = np.isfinite(scale) & (scale > 0)
    if not free.any():
        return UNKNOWN
    above, below = ((part[:, free] / scale[free]).sum(axis=1) for part in (numerator, denominator))
    return ratio_interval(above, below)


_ALIKE = 0.05
"""Standard deviation of log-ratios below which q is the posterior, and their tail nothing but rounding."""
_PARTS = 5
"""Parts of a fit's steps; the bound of the middle one is compared with that of the last."""


class ApproximationFigures(NamedTuple):
    """Figures of a fitted distribution.

    Attributes:
        pareto_k: Shape k; 0 where all ratios are alike.
        threshold: Above which k is too large for so many draws.
        bound: Bound of the log-evidence that was reached.
        bound_error: Its standard error.
        rise: By how much the bound rose in the second half of the fit; NaN of fewer than 25 steps.
        rise_error: Standard error of that.
    """

    pareto_k: float
    threshold: float
    bound: float
    bound_error: float
    rise: float
    rise_error: float


def approximation_figures(tree: xr.DataTree) -> ApproximationFigures | None:
    """Figures of a result whose smoother fitted a distribution; None of any other."""
    ratios, bound = (variable(tree, "approximation", name) for name in ("log_ratio", "bound"))
    if ratios is None or bound is None:
        return None
    ratios, count = np.asarray(ratios, np.float64), len(ratios)
    possible = ratios[np.isfinite(ratios)]
    reached, error = (possible.mean(), possible.std() / np.sqrt(count)) if len(possible) == count else (-np.inf, np.inf)
    return ApproximationFigures(_pareto_k(ratios, possible), min(1 - 1 / np.log10(count), 0.7), reached, error, *_rise(bound))


def _pareto_k(ratios: np.ndarray, possible: np.ndarray) -> float:
    if len(possible) < len(ratios) // 2:
        return np.inf
    if np.std(possible) < _ALIKE:
        return 0.0
    # ArviZ takes log-likelihoods, whose ratios are their inverses; what is impossible is not in the tail
    clipped = np.where(np.isfinite(ratios), ratios, possible.min() - 1.0)
    return float(array_stats().psislw(-clipped)[1])


def _rise(bound: np.ndarray) -> tuple[float, float]:
    size = len(bound) // _PARTS
    finite = np.asarray(bound, np.float64)
    if size < _PARTS:
        return np.nan, np.nan
    middle, last = finite[2 * size : 3 * size], finite[-size:]
    error = np.sqrt((np.nanvar(middle) + np.nanvar(last)) / size)
    return float(np.nanmean(last) - np.nanmean(middle)), float(error)
