r"""Size and autocorrelation of the errors of a recording's points, from the distances between rays.

The errors of C cameras in the same point have 2 C - 3 contrasts that do not depend on the point's position. Only these
contrasts are used, neither a body nor its motion. With m the pixels of a mm at the person and l the logit of the confidence,
errors are

    scale_(tck) Student-t_4,    log scale_(tck) = log m + mean + keypoint_k + camera_c + slope (l_(tck) - l_0)

with normal priors. Fisher scoring of the contrasts' density finds the mode and the covariance of these parameters. The noise
has the expected variance, because a short recording determines a keypoint's scale poorly. A share of the errors' variance
decays with a time constant. Both are fitted to the contrasts' autocorrelation, under a prior. Frames within that time are
redundant, and count as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy
from scipy.special import expit

from poseppl.arrays import Booleans, Floats, Integers
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.geometry.recorded_frames import image_slopes
from poseppl.motion.keypoints.detector_errors import FREEDOM, logits, magnifications

SIZE, SIZE_SPREAD = 15.0, 0.5
"""Prior of the scale at the person: median, mm, and standard deviation of its log; ours."""
KEYPOINT_SPREAD, CAMERA_SPREAD = 0.4, 0.2
"""Standard deviations of the logs of a keypoint's and a camera's scale beside the mean; ours."""
SLOPE, SLOPE_SPREAD = -0.2, 0.3
"""Prior of the slope; ours."""
SHARE_SPREAD, LASTS, LASTS_SPREAD = 1.5, 0.5, 0.7
"""Prior of the autocorrelated errors: standard deviation of the share's logit, about one half; median, s, and standard
deviation of the log of the time; ours."""
STANDARD_DEVIATION = float(np.sqrt(FREEDOM / (FREEDOM - 2)))
"""Standard deviation of the Student-t, in scales. The error of a position made from several points is a sum of their errors,
whose variances add."""
MAX_FRAMES, NUM_RUNS = 2000, 5
"""Frames that are used at most, in so many runs."""
_ROUNDS = 8
_LAGS, _LONGEST, _LARGEST, _MOST_ALIKE = 8, 2.0, 3.0, 0.95
"""Lags at which errors are compared with themselves, and the longest, s; larger errors, in scales, count as so large; and the
correlation that is the surest."""


class PointErrors(NamedTuple):
    """The errors of the points of K keypoints in C cameras.

    Attributes:
        log_mm: (K,) logs of the scales at the person, mm, at the middle confidence, over cameras.
        by_camera: (C,) what a camera adds to them.
        slope: Change of the log scale when the logit of the confidence grows by one.
        middle: The middle logit.
        share: Share of the errors' variance that is autocorrelated.
        lasts: Its time constant, s.
        covariance: Covariance (2 + C + K, 2 + C + K) of the mean, slope, cameras and keypoints.
    """

    log_mm: Floats
    by_camera: Floats
    slope: float
    middle: float
    share: float
    lasts: float
    covariance: Floats

    @property
    def uncertainty(self) -> Floats:
        """Standard deviations (C, K) of the logs of the scales at the middle confidence."""
        cameras = len(self.by_camera)
        of_mean, _, of_camera, of_keypoint = np.split(np.eye(len(self.covariance)), [1, 2, 2 + cameras])
        sums = (of_mean + of_camera)[:, None] + of_keypoint
        return np.asarray(np.sqrt(np.einsum("cki,ij,ckj->ck", sums, self.covariance, sums)))

    def in_new_camera(self) -> PointErrors:
        """Errors in another camera, whose points are unknown."""
        rows = np.r_[:3, 2 + len(self.by_camera) : len(self.covariance)]
        covariance = self.covariance[np.ix_(rows, rows)]
        covariance[2], covariance[:, 2] = 0.0, 0.0
        covariance[2, 2] = CAMERA_SPREAD**2
        return self._replace(by_camera=np.zeros(1), covariance=covariance)

    def scales(self, magnification: Floats, confidence: Floats) -> Floats:
        """Scales (T, C, K), px, of the Student-t's where a mm has so many pixels, and for such confidences (T, C, K)."""
        above = logits(confidence) - self.middle
        return np.asarray(magnification * np.exp(self.log_mm + self.by_camera[:, None] + self.slope * above))

    def noise(self, cameras: Cameras, markers: Sequence[str], places: Floats, confidence: Floats) -> Floats:
        """Standard deviations (T, C, K), px, by the expected variance; arguments as of ``DetectorErrors.noise``."""
        deviation = STANDARD_DEVIATION * np.exp(self.uncertainty**2)  # of a log-normal scale
        return np.asarray(deviation * self.scales(magnifications(cameras, places), confidence))

    def record(self, markers: Sequence[str]) -> dict[str, Any]:
        """The same as plain values: mm, seconds and shares."""
        scales = {name: round(float(np.exp(value)), 2) for name, value in zip(markers, self.log_mm, strict=True)}
        return {"scale": scales, "slope": round(self.slope, 3), "share": round(self.share, 4), "lasts": round(self.lasts, 4)}


class _Contrasts(NamedTuple):
    """Contrasts of points, free of their positions, in units of scales, and the projections (T, K, 2 C, 2 C) onto them."""

    values: Floats
    kept: Floats

    def by_camera(self) -> tuple[Floats, Floats]:
        """Sums of squares (T, C, K), and what they are expected to be."""
        shape = (*self.values.shape[:2], -1, 2)
        expected = np.diagonal(self.kept, axis1=-2, axis2=-1).reshape(shape).sum(-1)
        return np.moveaxis(np.square(self.values).reshape(shape).sum(-1), 2, 1), np.moveaxis(expected, 2, 1)


def point_errors(cameras: Cameras, points: Floats, confidence: Floats, rate: float) -> PointErrors | None:
    """Find the errors of points.

    Args:
        cameras: C cameras.
        points: (T, C, K, 2) px; NaN where a point was not seen.
        confidence: (T, C, K).
        rate: Frames a second.

    Returns:
        The errors; None where no point is seen by two cameras.
    """
    runs = _runs(len(points))
    rows = np.concatenate(runs)
    points, confidence = points[rows], confidence[rows]
    places = triangulate(cameras, points, confidence)
    known = np.asarray(np.isfinite(points).all(-1)) & np.asarray(np.isfinite(places).all(-1))[:, None]
    if not known.any():
        return None
    logit = logits(confidence)
    size, middle = magnifications(cameras, places), float(np.median(logit[known]))
    means, spreads = _prior(*points.shape[1:3])
    design = _regressors(known, logit - middle) * spreads
    own = _of_params(means, points.shape[1], middle, 0.5, LASTS, np.diag(spreads**2))
    v = np.zeros_like(means)
    for _ in range(_ROUNDS):
        found = _contrasts(cameras, points, known, own.scales(size, confidence))
        v, covariance = _scored(v, found, known, design, 1 / (1 + own.lasts * rate))
        covariance = spreads[:, None] * covariance * spreads
        own = _of_params(means + spreads * v, points.shape[1], middle, *_lasting(found, runs, rate), covariance)
    return own


def _runs(count: int) -> list[Integers]:
    """All frames, or runs of them that are spread over the recording."""
    if count <= MAX_FRAMES:
        return [np.arange(count)]
    length = MAX_FRAMES // NUM_RUNS
    return [np.arange(first, first + length) for first in np.linspace(0, count - length, NUM_RUNS).astype(int)]


def _prior(num_cameras: int, num_keypoints: int) -> tuple[Floats, Floats]:
    """Means and standard deviations of the params: mean, slope, cameras, keypoints."""
    means = np.array([np.log(SIZE), SLOPE])
    spreads = np.repeat([SIZE_SPREAD, SLOPE_SPREAD, CAMERA_SPREAD, KEYPOINT_SPREAD], [1, 1, num_cameras, num_keypoints])
    return np.pad(means, (0, num_cameras + num_keypoints)), spreads


def _of_params(params: Floats, num_cameras: int, middle: float, share: float, lasts: float, covariance: Floats) -> PointErrors:
    (mean, slope), by_camera, by_keypoint = np.split(params, [2, 2 + num_cameras])
    return PointErrors(mean + by_keypoint, by_camera, float(slope), middle, share, lasts, covariance)


def _contrasts(cameras: Cameras, points: Floats, known: Booleans, scale: Floats) -> _Contrasts:
    """The contrasts of known points about the places that they tell."""
    weight = np.where(known, 1 / scale, 0.0)
    places = np.nan_to_num(triangulate(cameras, points, np.square(weight * scale.min())))
    seen, by_place = (np.swapaxes(each, 0, 1) for each in image_slopes(cameras, places))  # (T, C, K, 2, ...)
    weight = np.moveaxis(weight, 1, 2)[..., None]
    values = weight * np.moveaxis(np.where(known[..., None], points - seen, 0.0), 1, 2)
    slopes = weight[..., None] * np.swapaxes(by_place, 1, 2)
    shape = (*values.shape[:2], -1)
    values, slopes = values.reshape(shape), slopes.reshape(*shape, 3)
    information = np.swapaxes(slopes, -1, -2) @ slopes
    ridge = 1e-9 * np.trace(information, axis1=-2, axis2=-1) + 1e-12
    there = np.repeat(np.moveaxis(known, 1, 2), 2, -1)
    moved = slopes @ np.linalg.inv(information + ridge[..., None, None] * np.eye(3)) @ np.swapaxes(slopes, -1, -2)
    kept = there[..., None] * np.eye(there.shape[-1]) - moved
    return _Contrasts((kept @ values[..., None])[..., 0], kept)


def _regressors(known: Booleans, above: Floats) -> Floats:
    """Contribution of each param to the log scales of the known points (N, p)."""
    _, camera, keypoint = np.nonzero(known)
    own = np.stack([np.ones(len(camera)), above[known]], 1)
    return np.hstack([own, np.eye(known.shape[1])[camera], np.eye(known.shape[2])[keypoint]])


def _scored(v: Floats, found: _Contrasts, known: Booleans, design: Floats, independent: float) -> tuple[Floats, Floats]:
    """A step of Fisher scoring of the params in units of their prior, about its mean.

    Args:
        v: The params (p,).
        found: Contrasts under these.
        known: Which points there are (T, C, K).
        design: Contribution of each param to their log scales (N, p).
        independent: Share of the frames that count as independent.

    Returns:
        Params, and the covariance (p, p) of those before.
    """
    squares, expected = found.by_camera()
    count = expected.sum(1, keepdims=True)
    weight = (FREEDOM + count) / (FREEDOM + squares.sum(1, keepdims=True))
    slope = (weight * squares - expected)[known]
    bend = (2 * expected * FREEDOM / (FREEDOM + count + 2))[known]
    covariance = np.linalg.inv(np.eye(len(v)) + independent * design.T @ (bend[:, None] * design))
    return v + covariance @ (independent * design.T @ slope - v), covariance


def _lasting(found: _Contrasts, runs: Sequence[Integers], rate: float) -> tuple[float, float]:
    """Share of the autocorrelated errors, and their time constant, s."""
    squares, count = np.square(found.values).sum(-1), np.trace(found.kept, axis1=-2, axis2=-1)
    values = found.values * np.minimum(1, _LARGEST * np.sqrt(count / np.maximum(squares, 1e-9)))[..., None]
    longest = min(_LONGEST * rate, 0.6 * len(runs[0]))
    lags = np.unique(np.r_[0, np.geomspace(1, max(longest, 1), _LAGS).astype(int)])
    lags = lags[lags < len(runs[0])]
    product, expected, first = np.zeros(len(lags)), np.zeros(len(lags)), 0
    for run in runs:
        own, kept = values[first : first + len(run)], found.kept[first : first + len(run)]
        first += len(run)
        for i, lag in enumerate(lags):
            product[i] += np.sum(own[lag:] * own[: len(own) - lag])
            expected[i] += np.einsum("tkij,tkij->", kept[lag:], kept[: len(own) - lag])
    if len(lags) < 2 or product[0] <= 0:
        return 0.5, LASTS
    alike = product[1:] / np.maximum(expected[1:], 1e-9) * expected[0] / product[0]
    sure = np.sqrt(count.sum() / (1 + LASTS * rate)) / (1 - np.clip(alike, 0, _MOST_ALIKE) ** 2)  # Fisher's, of a correlation

    def off(p: Floats) -> Floats:
        there = expit(SHARE_SPREAD * p[0]) * np.exp(-lags[1:] / rate / (LASTS * np.exp(LASTS_SPREAD * p[1])))
        return np.concatenate([sure * (alike - there), p])

    p = scipy.optimize.least_squares(off, np.zeros(2)).x
    return float(expit(SHARE_SPREAD * p[0])), float(LASTS * np.exp(LASTS_SPREAD * p[1]))
