r"""The errors of a detector: how large they are, by keypoint and confidence.

A camera sees a keypoint k with confidence c, whose logit is l. One mm at the point is m px long in the picture. Then

    y ~ (1 - pi) Student-t_4(truth, (s m)^2 I) + pi Uniform(picture)
    log s = log_scale_k + slope (l - l_0),      logit pi = clutter + clutter_slope (l - l_0)

A scale is in mm at the person, so that it carries over to other cameras; the Student-t is bivariate.
:mod:`poseppl.motion.keypoints.detector_fit` finds the numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import expit, logit, ndtri, stdtrit

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.recorded_frames import depths
from poseppl.motion.points.named_points import MAX_SURE, MIN_SURE

FREEDOM = 4.0
"""Degrees of freedom of the errors; ours."""
GAUSSIAN = float(stdtrit(FREEDOM, 0.75) / ndtri(0.75))
"""Standard deviation of a Gaussian, in scales of the Student-t that has the same quartiles."""


class DetectorErrors(NamedTuple):
    """The errors of a detector.

    Attributes:
        log_scale: Log scale of each keypoint, by its marker's name: log mm at the person, at the middle confidence.
        slope: By how much the log of the scale grows with the logit of the confidence.
        clutter: Log-odds of clutter at the middle confidence.
        clutter_slope: By how much they grow with the logit.
        confidence: The middle one, of logit l_0.
        counts: Counts of each keypoint, by name, the number of residuals behind the estimates.
        source: Recording that they were estimated from.
    """

    log_scale: Mapping[str, float]
    slope: float
    clutter: float
    clutter_slope: float
    confidence: float
    counts: Mapping[str, int]
    source: str

    def log_scales(self, markers: Sequence[str]) -> Floats:
        """Log scales (K,) of K markers; unknown ones have the mean of the others."""
        mean = float(np.mean(list(self.log_scale.values())))
        return np.array([self.log_scale.get(name, mean) for name in markers])

    def scale_and_odds(self, log_scale: Floats, logit_confidence: Floats) -> tuple[Floats, Floats]:
        """Scales, mm at the person, and log-odds of clutter of points seen with confidences of these logits."""
        above = logit_confidence - logit(self.confidence)
        return np.asarray(np.exp(log_scale + self.slope * above)), np.asarray(self.clutter + self.clutter_slope * above)

    def noise(self, cameras: Cameras, markers: Sequence[str], places: Floats, confidence: Floats) -> Floats:
        """Standard deviations (T, C, K), px, of Gaussians with the quartiles of the errors; clutter has no precision.

        With the probability 1 - pi that a point is none, that is the share of the errors' precision that is expected of it.

        Args:
            cameras: C cameras.
            markers: K names.
            places: (T, K, 3) about where they are, mm; NaN where unknown, and then the middle of the others is taken.
            confidence: (T, C, K).

        Raises:
            InputError: Nothing tells how far from a camera the person is.
        """
        size = magnifications(cameras, places)
        if not np.isfinite(size).all():
            raise InputError(
                "a camera's distance from the person is not known",
                field=Argument("noise"),
                expected="two cameras that see the person",
            )
        scale, odds = self.scale_and_odds(self.log_scales(markers), logits(confidence))
        return np.asarray(GAUSSIAN * scale * size / np.sqrt(expit(-odds)))


def logits(confidence: Floats) -> Floats:
    """Logits of confidences, which are kept away from 0 and 1."""
    return np.asarray(logit(np.clip(np.nan_to_num(confidence), MIN_SURE, MAX_SURE)))


def magnifications(cameras: Cameras, places: Floats) -> Floats:
    """Pixels (T, C, K) that a mm at places (T, K, 3) has in each camera; where a place is unknown, their median; or NaN."""
    focal = np.abs(np.asarray(cameras.focal, np.float64)).mean(-1)[:, None, None]
    far = depths(cameras, np.nan_to_num(places))
    size = np.where(np.isfinite(places).all(-1) & (far > 0), focal / np.maximum(far, 1.0), np.nan)
    middle = [np.median(known) if (known := each[np.isfinite(each)]).size else np.nan for each in size]
    return np.asarray(np.moveaxis(np.where(np.isfinite(size), size, np.reshape(middle, (-1, 1, 1))), 0, 1))
