"""Predictive checks of a filter, judged without a truth: how much larger errors are than it claims, and its updates.

An innovation z = y - E[y | past] has the error e of the predicted state in it and the noise of the data. The filter claims that
e has the variance P (``state_variance``) and the noise R (``noise_variance``); let rho be the true variance of e over P, and
G = P / (P + R) the gain. With standardised innovations z / sqrt(P + R), two moments determine rho:

* their square:       E[z_t^2] = 1 + G (rho - 1),
* their products:     E[z_t z_(t-1)] ~ G (1 - G) (rho - 1),

the second because the innovations of a filter with the right gain are uncorrelated from frame to frame (Mehra 1970,
doi:10.1109/TAC.1970.1099422), while an overconfident filter corrects too little of an error. The first determines rho where the
state is less certain than the data, the second also where the noise hides it. Both are estimated over all entries and frames,
with standard errors by batches of frames, and joined by inverse variance. Innovations are cut off at four standard deviations,
so that a few gross errors do not decide.

If the predictions are right, the ranks u_t of the innovation chi-square are exactly uniform and independent. Fisher's sum -2
sum log(1 - u_t) then has the chi-square distribution with 2 T degrees of freedom (Fisher 1932, section 21.1), and `chance` is
its tail probability. It needs no batches, so it also works for short sequences. The innovation chi-square over its mean, less
1, divided by the state's share in that mean, is another estimate of rho - 1. It includes errors that no entry shows by itself,
such as those of a filter that has lost the right mode.

A rho below 1 judges predictions, not the states after their data: of a gain near 1 these hardly depend on the prediction.
Products show what is too large. With kappa, the true variance of the noise over the claimed one, E[z_t z_(t-1)] is
G (1 - G) (rho - kappa): a transition that is too wide makes neighbouring innovations unlike, noise that is too wide makes them
alike. So does motion that is steadier than the transition, whose innovations are autocorrelated; there intervals of the states
may be right or too narrow. `chance_low` is the lower tail of -2 sum log u_t: innovations smaller than predicted.

Intervals of 90 % of a Gaussian posterior whose true variance is rho times the claimed one cover 2 Phi(1.645 / sqrt(rho)) - 1.

>>> round(implied_coverage(1.0), 3), round(implied_coverage(1.65), 2)
(0.9, 0.8)

Its updates are checked with draws of the state after frame t - 1, which are moved by the transition and weighted by the
likelihood of frame t's data. They are draws of the posterior that follows from the filter's own result at t - 1 (importance
sampling from the prediction). Their mean w_t and covariance W_t estimate those of the posterior, for which the filter reports
m_t and P_t. If its updates are right, both agree; a filter that linearises too boldly, or counts a frame's data twice, is
overconfident or biased. The next frame inherits both through K_t, the effect that an error of the previous state has after the
frame's data. A small displacement in each frame, always to one side, adds up,

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
from scipy.special import chdtrc, ndtr, ndtri

from poseppl.arrays import Floats
from poseppl.diagnostics.batches import Interval, mean_interval, ratio_interval
from poseppl.runs.predictive import DataPrediction, StatePrediction

_CUT = 4.0
"""Standard deviations at which an innovation is cut off."""
_MAX = 4.0
"""The largest innovation chi-square of a frame, over its mean, that counts."""
_OUTER = 0.1
"""Probability of the outer tails."""
_MIN = 1e-6
"""Least upper tail of a rank; single precision may round to 0."""


class PredictiveFigures(NamedTuple):
    """Figures of a sequence.

    Attributes:
        inflation: rho, the variance of the state's errors over the claimed one; 1 is right.
        by_squares: rho by the innovations' squares alone.
        by_products: rho by the products of neighbouring innovations alone.
        by_chi_square: rho by all entries of a frame at once; NaN if the state's share in the predictions is unknown.
        outer: Share of the data in the outer 10 % of their predictive distributions.
        high: Share of the data above their predictive median.
        chi_square: Innovation chi-square over its expectation, averaged over the frames.
        chance: Probability of innovations as large as these or larger if the predictions are right; NaN where nothing was seen.
        chance_low: Probability of innovations as small as these or smaller.
    """

    inflation: Interval
    by_squares: Interval
    by_products: Interval
    by_chi_square: Interval
    outer: Interval
    high: Interval
    chi_square: Interval
    chance: float
    chance_low: float


def predictive_figures(prediction: DataPrediction) -> PredictiveFigures:
    """Sum the predictive checks of a sequence up.

    Args:
        prediction: With a leading T.
    """
    values = (np.asarray(np.nan if leaf is None else leaf, np.float64) for leaf in prediction)
    transform, innovation, state, noise, chi_square, ranks, share = values
    known, total = np.isfinite(transform), np.where(state + noise > 0, state + noise, np.nan)
    gain, white = state / total, np.clip(innovation / np.sqrt(total), -_CUT, _CUT)
    squares = ratio_interval(white**2 - 1, gain)
    # a product belongs to the later frame; the gain is that of the earlier one, which should have taken the error away
    products = ratio_interval(white[1:] * white[:-1], (gain * (1 - gain))[:-1])
    return PredictiveFigures(
        inflation=_one_more(_joined(squares, products)),
        by_squares=_one_more(squares),
        by_products=_one_more(products),
        by_chi_square=_one_more(ratio_interval(np.minimum(chi_square, _MAX) - 1, share)),
        outer=mean_interval(np.where(known, np.abs(transform - 0.5) > (1 - _OUTER) / 2, np.nan)),
        high=mean_interval(np.where(known, transform > 0.5, np.nan)),
        chi_square=mean_interval(chi_square),
        chance=_chance(ranks[np.isfinite(ranks)]),
        chance_low=_chance(1 - ranks[np.isfinite(ranks)]),
    )


def implied_coverage(inflation: float) -> float:
    """Coverage of 90 % intervals of a Gaussian whose true variance is so many times the claimed one."""
    return float(2 * ndtr(ndtri(0.95) / np.sqrt(max(inflation, 1e-9))) - 1)


def farthest_stretch(prediction: DataPrediction) -> tuple[int, int]:
    """First and last of the frames in a row, of those with data, that stand out most by the ranks of their chi-squares.

    It is where the sum of -log(1 - u_t) - 2 is largest; a term is -1 on average if predictions are right.
    """
    ranks = np.asarray(prediction.chi_square_transform, np.float64)
    surprise = np.where(np.isfinite(ranks), _surprise(ranks) - 2, 0.0)
    total = np.cumsum(np.r_[0.0, surprise])
    end = int(np.argmax(total[1:] - np.minimum.accumulate(total)[:-1])) + 1
    return int(np.argmin(total[:end])), end - 1


def _surprise(ranks: Floats) -> Floats:
    return np.asarray(-np.log(np.maximum(1 - ranks, _MIN)))


def _chance(ranks: Floats) -> float:
    """Upper tail of Fisher's sum."""
    if not len(ranks):
        return float("nan")
    return float(chdtrc(2 * len(ranks), 2 * _surprise(ranks).sum()))


def _one_more(interval: Interval) -> Interval:
    return interval._replace(estimate=interval.estimate + 1)


def _joined(first: Interval, second: Interval) -> Interval:
    """Two estimates by inverse variance; one of them where the other is unknown."""
    known = [found for found in (first, second) if np.isfinite(found.estimate) and found.standard_error > 0]
    if not known:
        return first
    errors = np.array([found.standard_error for found in known])
    weights = errors**-2 / np.sum(errors**-2)
    reaches = np.array([found.half_width for found in known])
    error, reach = (float(np.sqrt(np.square(weights * part).sum())) for part in (errors, reaches))
    return Interval(float(weights @ [found.estimate for found in known]), error, reach)


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
