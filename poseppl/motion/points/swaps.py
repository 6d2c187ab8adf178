r"""Limbs that a detector takes for each other: whether it does, for each pair, camera and frame, as a probability.

Whether the points of a pair of limbs are exchanged in a camera's picture is a Markov chain of two states,

    P(s_0 = 1) = SHARE,    P(s_t = 1 | s_(t-1) = 0) = SHARE (1 - k),    P(s_t = 1 | s_(t-1) = 1) = SHARE + (1 - SHARE) k,

k = exp(-elapsed / LASTS). Given where the points are, it is summed out exactly, by forward filtering and backward smoothing.
Data are Student-t around where the points are seen, mixed with clutter. An exchange with a probability above 0.5 is undone,
and the points are smoothed again. This is one step of expectation maximisation. It suffices where most frames are right:
rare exchanges count as clutter at first, and do not lead the points away.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import expit, log_expit, logsumexp

from poseppl.arrays import Floats
from poseppl.motion.points.named_points import FREEDOM

SHARE, LASTS = 0.02, 0.1
"""Share of the time in which limbs are exchanged, and how many seconds they stay so; our choice."""

Pair = tuple[tuple[int, ...], tuple[int, ...]]
"""Indices of the left and of the right points of two limbs."""


class SeenPoints(NamedTuple):
    """Predicted image points, and how far detections may be from them.

    Attributes:
        images: (T, C, K, 2) px.
        scales: (T, C, K) px.
        clutter: (T, C, K) log-odds of clutter.
        sizes: (C, 2) of the pictures, px.
    """

    images: Floats
    scales: Floats
    clutter: Floats
    sizes: Floats

    def log_density(self, points: Floats, of: Sequence[int]) -> Floats:
        """Log-density (T, C) of points (T, C, n, 2) as those of indices ``of``; what was not found counts nothing."""
        proper, wrong = self._parts(points, list(of))
        whole = np.logaddexp(proper, wrong)
        return np.asarray(np.where(np.isfinite(points).all(-1), whole, 0.0).sum(-1))

    def clutter_probability(self, points: Floats) -> Floats:
        """Probability (T, C, K) that points (T, C, K, 2) are clutter; NaN where nothing was found."""
        proper, wrong = self._parts(points, list(range(points.shape[2])))
        return np.asarray(np.where(np.isfinite(points).all(-1), expit(wrong - proper), np.nan))

    def _parts(self, points: Floats, index: list[int]) -> tuple[Floats, Floats]:
        """Log-densities (T, C, n) of points that are what they are said to be, and of clutter, each with its share."""
        scale, odds = self.scales[..., index], self.clutter[..., index]
        white = np.nan_to_num((points - self.images[..., index, :]) / scale[..., None])
        peak = scipy.stats.multivariate_t(np.zeros(2), np.eye(2), FREEDOM).logpdf(white.reshape(-1, 2)).reshape(scale.shape)
        return log_expit(-odds) + peak - 2 * np.log(scale), log_expit(odds) - np.log(self.sizes).sum(-1)[:, None]


def swap_probabilities(points: Floats, seen: SeenPoints, pairs: Sequence[Pair], elapsed: Floats) -> Floats:
    """Probabilities (T, C, P) that the limbs of each pair are exchanged.

    Args:
        points: Detections (T, C, K, 2), NaN where there is none.
        seen: Their predicted image points.
        pairs: P pairs of limbs.
        elapsed: (T,) seconds since the frame before; the first is not read.
    """
    found = np.empty((*points.shape[:2], len(pairs)))
    for number, (left, right) in enumerate(pairs):
        kept = seen.log_density(points[:, :, [*left, *right]], [*left, *right])
        swapped = seen.log_density(points[:, :, [*right, *left]], [*left, *right])
        found[..., number] = two_state_smoothing(np.stack([kept, swapped], -1), elapsed)
    return found


def two_state_smoothing(log_likelihood: Floats, elapsed: Floats) -> Floats:
    """Probabilities (T, ...) of the second state given all data, whose log-likelihoods (T, ..., 2) are those of both."""
    kept = np.exp(-elapsed / LASTS)
    enters = SHARE * (1 - kept)
    stays = enters + kept
    moves = np.log(np.stack([np.stack([1 - enters, enters], -1), np.stack([1 - stays, stays], -1)], -2))  # (T, from, to)
    forward = [np.log([1 - SHARE, SHARE]) + log_likelihood[0]]
    for t in range(1, len(log_likelihood)):
        forward.append(logsumexp(forward[-1][..., None] + moves[t], axis=-2) + log_likelihood[t])
    backward = [np.zeros_like(forward[-1])]
    for t in range(len(log_likelihood) - 1, 0, -1):
        backward.append(logsumexp(moves[t] + (log_likelihood[t] + backward[-1])[..., None, :], axis=-1))
    both = np.stack(forward) + np.stack(backward[::-1])
    return np.asarray(expit(both[..., 1] - both[..., 0]))


def exchanged(points: Floats, probabilities: Floats, pairs: Sequence[Pair]) -> Floats:
    """Values (T, C, K, ...) of points with the limbs exchanged where that is more likely than not."""
    corrected = points.copy()
    for number, (left, right) in enumerate(pairs):
        rows, cameras = np.nonzero(probabilities[..., number] > 0.5)
        for one, other in zip(left, right, strict=True):
            corrected[rows, cameras, one], corrected[rows, cameras, other] = (
                points[rows, cameras, other],
                points[rows, cameras, one],
            )
    return corrected
