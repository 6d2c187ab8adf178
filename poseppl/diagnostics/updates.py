r"""Whether a filter's posterior is what its own prediction and the frame's data make, which needs no truth.

Draws of the state after frame t - 1 are moved by the transition and weighted by the likelihood of frame t's data. They are
draws of the posterior that follows from the filter's own result at t - 1 (importance sampling from the prediction). Their mean
w_t and covariance W_t estimate those of the posterior, for which the filter reports m_t and P_t. If its updates are right, both
agree; a filter that linearises too boldly, or counts a frame's data twice, is overconfident or biased. The next frame inherits
both through K_t, the effect that an error of the previous state has after the frame's data. A small displacement in each frame,
always to one side, adds up,

    C_t = K_t C_(t-1) K_t' + W_t - P_t,
    D_t = K_t D_(t-1) + w_t - m_t,
    V_t = K_t V_(t-1) K_t' + W_t (1 / n_t + 1 / N_t),

V_t being the covariance that D_t has by chance, with the effective numbers n_t of the weighted draws and N_t of the filter's
own. Its errors have the variances diag(P_t + C_t + D_t D_t' - V_t) instead of diag P_t: the inflation of a coordinate is the
ratio of their sums over frames, and its mean over coordinates is reported. How large it comes out by chance is simulated. A
filter that makes less of its data than it could, and says so, is displaced by the data's chance, far in some frames and not in
others; so there is an error by batches of frames, too. Frames in which few draws carry the weight are not used, nor are states
of more than ten coordinates: innovations show more there.

Moments say little about shapes: a Gaussian between two modes has the right mean and variance, and covers neither mode. So
it is counted, too, how many of the weighted draws are in the filter's 90 % intervals, which an exact update makes 90 %.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import Interval, mean_interval, ratio_interval
from poseppl.runs.predictive import StatePrediction

MIN_DRAWS = 10.0
"""Effective number of weighted draws below which a frame is not used."""
_SIMULATIONS = 400


class UpdateFigures(NamedTuple):
    """How a filter's updates agree with importance sampling from its own predictions.

    Attributes:
        inflation: Variance of errors over the claimed one (d,); 1 is right.
        chance: Share of simulated sequences of right updates whose mean inflation is at least as large.
        over_frames: Mean inflation over coordinates, with its error by batches of frames.
        frames: The number of frames that are used.
    """

    inflation: Floats
    chance: float
    over_frames: Interval
    frames: int


def update_figures(
    prediction: StatePrediction, mean: ArrayLike, standard_deviation: ArrayLike, ess: ArrayLike
) -> UpdateFigures:
    """Compare a filter's posterior with its own prediction, weighted by the data's likelihood.

    Args:
        prediction: With a leading T.
        mean: The posterior's mean (T, d).
        standard_deviation: Its standard deviation (T, d).
        ess: The filter's effective number of draws (T,).
    """
    arrays = prediction.weighted_mean, prediction.weighted_covariance, prediction.memory, mean, standard_deviation
    centre, weighted, memory, found, deviation = (np.asarray(leaf, np.float64) for leaf in arrays)
    number, own = (np.nan_to_num(np.asarray(each, np.float64), posinf=np.inf) for each in (prediction.weighted_ess, ess))
    tells = (number >= MIN_DRAWS) & np.isfinite(centre).all(axis=1) & np.isfinite(memory).all(axis=(1, 2))
    share = 1 / np.maximum(number, MIN_DRAWS) + 1 / np.maximum(own, 1.0)
    # of the claimed covariance the variances are known; correlations are those of the weighted draws
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(deviation / np.sqrt(np.diagonal(weighted, axis1=1, axis2=2)))
    weighted, memory = (np.where(tells[:, None, None], each, 0.0) for each in (weighted, memory))
    claimed = ratio[:, :, None] * weighted * ratio[:, None]
    noise = share[:, None, None] * weighted
    surer, apart = (weighted - claimed)[:, None], np.where(tells[:, None], centre - found, 0.0)[:, None]
    whole = np.where(deviation.any(0), np.square(deviation).sum(0), np.nan)
    excess = _excess(memory, surer, apart, noise)[:, 0] / whole
    inflation: Floats = 1 + excess.sum(0)
    over_frames = ratio_interval(excess, np.square(deviation) / whole)
    over_frames = over_frames._replace(estimate=1 + over_frames.estimate)

    values, vectors = np.linalg.eigh(noise)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    rng = np.random.default_rng(0)
    variance = np.sqrt(2 * share)[:, None] * rng.standard_normal((len(memory), _SIMULATIONS))
    surer = variance[:, :, None, None] * weighted[:, None]
    apart = rng.standard_normal((len(memory), _SIMULATIONS, memory.shape[1])) @ root.swapaxes(1, 2)
    by_chance = _excess(memory, surer, apart, noise).sum(0) / whole
    chance = np.mean(np.nanmean(by_chance, axis=1) >= np.nanmean(inflation) - 1)
    return UpdateFigures(inflation, float(chance), over_frames, int(tells.sum()))


def update_coverage(prediction: StatePrediction, low: ArrayLike, high: ArrayLike) -> tuple[int, Interval]:
    """Share of the predicted states, weighted by the data's likelihood, in a filter's intervals, and the number of frames used.

    Args:
        prediction: With a leading T.
        low: The intervals' lower ends (T, d).
        high: Their upper ends (T, d).
    """
    draws, below, above = (np.asarray(leaf, np.float64) for leaf in (prediction.weighted_draws, low, high))
    inside = ((below[:, None] <= draws) & (draws <= above[:, None])).mean(axis=1)
    tells = np.asarray(prediction.weighted_ess) >= MIN_DRAWS
    # finite sites have no share: their intervals cover more than their level
    known = tells[:, None] & np.isfinite(prediction.explained) & (below < above)
    return int(tells.sum()), mean_interval(np.where(known, inside, np.nan))


def _excess(memory: Floats, surer: Floats, apart: Floats, noise: Floats) -> Floats:
    """The diagonals of C_t + D_t D_t' - V_t (T, S, d), from what each frame adds to C (T, S, d, d), D (T, S, d) and V."""
    excess = np.empty(apart.shape)
    less, displacement, chance = np.zeros(surer.shape[1:]), np.zeros(apart.shape[1:]), np.zeros(noise.shape[1:])
    for t, kept in enumerate(memory):
        less = kept @ less @ kept.T + surer[t]
        displacement = displacement @ kept.T + apart[t]
        chance = kept @ chance @ kept.T + noise[t]
        excess[t] = np.diagonal(less, axis1=1, axis2=2) + displacement**2 - np.diagonal(chance)
    return excess
