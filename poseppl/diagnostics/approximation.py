r"""How near a fitted distribution is to the posterior: Pareto's k of its draws' importance ratios, and its bound.

With r_i = p(x_i, z) / q(x_i) of N trajectories x_i ~ q, the largest ratios follow a generalised Pareto distribution of shape k
(Vehtari, Simpson, Gelman, Yao and Gabry 2024, https://jmlr.org/papers/v25/19-556.html). Above min(1 - 1 / log10 N, 0.7) the
posterior has mass that q does not reach (Yao et al. 2018, arXiv:1802.02538, of variational fits). The ratios are those of whole
trajectories: k judges all frames jointly, and is stricter than a single frame's interval needs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from poseppl.diagnostics.autocorrelation import array_stats
from poseppl.runs.contents import variable

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
