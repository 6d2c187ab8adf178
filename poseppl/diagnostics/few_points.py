r"""Monte Carlo error that a filter of few points hands on from frame to frame, which needs no truth.

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

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.diagnostics.unreached import handed_on
from poseppl.runs.predictive import StatePrediction


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
