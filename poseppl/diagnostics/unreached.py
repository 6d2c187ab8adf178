"""Weakly informed coordinates, and the Monte Carlo error that a filter of few points hands on: neither needs a truth.

If a filter is right, the posterior's mean m_t and variance P_t of any coordinate obey, given the frames before,

    E[P_t] + Var(m_t) = Q_t,

Q_t being the predicted variance (law of total variance). The frame's data reduce Q_t by at most a share s_t, which follows from
their Fisher information before they come (the posterior Cramer-Rao bound, Tichavsky, Muravchik and Nehorai 1998,
doi:10.1109/78.668800, of Gaussian predictions). If s_t is close to zero, P_t must stay at Q_t and m_t at the predicted mean
p_t. A filter of too few particles loses variance there by chance, while its mean drifts, and both look as if it had learned. So
its errors have a variance beyond P_t by an excess X_t, which the next frame inherits in the measure in which a coordinate
remembers itself, by a slope a_t:

    X_t = ((1 - s_t) a_t)^2 X_(t-1) + (Q_t - P_t - s_t Q_t) + ((m_t - p_t)^2 - s_t Q_t - e_t^2),

e_t being the Monte Carlo error of m_t - p_t, by the filter's effective draws and those of the prediction. The inflation is
1 + sum X_t / sum P_t over frames and coordinates: 1 is right. Its interval is by batches of frames.

A posterior that n points carry to the next frame, by their mixture, has a mean with the error P_t / n. Its variance is too
small by P_t / n on average. P_t is the posterior variance of a coordinate. Errors are then larger than the filter claims, by an
excess of variance X_t. A frame passes on the part of this excess that its data leave and that the transition keeps: the matrix
K_t of :mod:`poseppl.runs.predictive` (`transfer`):

    X_t = K_t (X_(t-1) + 2 P_(t-1) / n) K_t'.

Without K_t, and for up to ten or more than 40 coordinates, each coordinate is treated by itself, with (1 - s_t) a_t in place of
K_t. Here s_t is the share of variance that data can explain, and a_t the slope of :mod:`poseppl.diagnostics.unreached`. For a
body that would miss most of the excess: data inform each coordinate, but not what several have in common, such as the depth in
one camera. A coordinate's inflation is 1 + sum X_t / sum P_t over frames. It has no random error, so it also works for short
sequences. It is of first order in 1 / n.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Booleans, Floats
from poseppl.diagnostics.batches import Interval, ratio_interval
from poseppl.runs.predictive import StatePrediction

HARDLY = 0.1
"""Share of a coordinate's predicted variance, up to which it is weakly informed by a frame's data."""


class UnreachedFigures(NamedTuple):
    """Figures of the weakly informed coordinates of a sequence.

    Attributes:
        coordinates: Which they are, booleans (d,).
        inflation: Variance of their errors over the claimed one; 1 is right.
        lost: Share of their predicted variance that the filter gives away in a frame.
        explained: Share that the data can explain.
    """

    coordinates: Booleans
    inflation: Interval
    lost: float
    explained: float


def weakly_observed_stats(
    prediction: StatePrediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike
) -> UnreachedFigures | None:
    """Compare a filter's posterior with its own prediction in weakly informed coordinates.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).

    Returns:
        The figures; None where data reach all coordinates.
    """
    state = prediction.predicted_mean, prediction.predicted_variance, prediction.predicted_error
    centre, predicted, error = (np.asarray(leaf, np.float64) for leaf in state)
    explained = np.nan_to_num(np.asarray(prediction.explained, np.float64), nan=1.0)
    variance = np.square(np.asarray(standard_deviation, np.float64))
    reached = explained * predicted
    hardly = reached.sum(axis=0) < HARDLY * predicted.sum(axis=0)
    if not hardly.any():
        return None
    errors = error**2 + variance / np.maximum(np.asarray(ess, np.float64), 1.0)[:, None]
    excess = (predicted - variance - reached) + (np.square(np.asarray(mean, np.float64) - centre) - reached - errors)
    kept = _kept(handed_on(prediction))
    ratio = ratio_interval((kept * excess)[:, hardly], variance[:, hardly])
    whole = predicted[:, hardly].sum()
    return UnreachedFigures(
        hardly,
        ratio._replace(estimate=ratio.estimate + 1),
        float((predicted - variance)[:, hardly].sum() / whole),
        float(reached[:, hardly].sum() / whole),
    )


def handed_on(prediction: StatePrediction) -> Floats:
    """Share (T, d) of a variance of errors that each frame has of the one before: what data leave and the transition keeps."""
    explained, slope = (np.asarray(leaf, np.float64) for leaf in (prediction.explained, prediction.autoregression))
    return np.nan_to_num(np.clip((1 - explained) * slope, -1.0, 1.0) ** 2)


def _kept(inherited: Floats) -> Floats:
    """Times (T, d) that a frame's excess counts in this and all later frames, of which each inherits such a share."""
    kept = np.ones_like(inherited)
    for t in range(len(kept) - 2, -1, -1):
        kept[t] += inherited[t + 1] * kept[t + 1]
    return kept


def finite_sample_inflation(
    prediction: StatePrediction, standard_deviation: ArrayLike, points: int, draws: ArrayLike | None = None
) -> Floats:
    """Variance of a filter's errors over the claimed one that the number of its points makes one expect, at least.

    Args:
        prediction: With a leading T, and with moments of the state.
        standard_deviation: The posterior's (T, d).
        points: Their number n.
        draws: Some of the posterior's (S, T, d), for its covariances; without them each coordinate is on its own.

    Returns:
        The inflation (d,); 1 is right, and NaN is that of a coordinate that is known exactly.
    """
    variance = np.square(np.asarray(standard_deviation, np.float64))
    excess, known = np.zeros_like(variance), draws is not None and prediction.transfer is not None
    if known:
        transfer, drawn = np.nan_to_num(np.asarray(prediction.transfer, np.float64)), np.asarray(draws, np.float64)
        handed, lost = np.zeros(transfer.shape[1:]), 2 * _covariances(drawn) / points
        for t in range(1, len(variance)):
            handed = transfer[t] @ (handed + lost[t - 1]) @ transfer[t].T
            excess[t] = np.diagonal(handed)
    else:
        share = handed_on(prediction)
        for t in range(1, len(variance)):
            excess[t] = share[t] * (excess[t - 1] + 2 * variance[t - 1] / points)
    whole = variance.sum(axis=0)
    inflation: Floats = 1 + excess.sum(axis=0) / np.where(whole > 0, whole, np.nan)
    return inflation


def _covariances(draws: Floats) -> Floats:
    centred = draws - draws.mean(axis=0)
    covariances: Floats = np.einsum("sti,stj->tij", centred, centred) / max(len(draws) - 1, 1)
    return covariances
