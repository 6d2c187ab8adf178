"""What remains of each camera's points between them and the places that all cameras' rays pass by: noise and bias."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, project

MIN_RESIDUALS = 30
"""Points of a camera, at least, that tell its errors."""


class CameraErrors(NamedTuple):
    """What remains of each camera's points between them and the places that all cameras' rays pass by.

    Attributes:
        scale: (C,) standard deviation of a coordinate, px, bias included; NaN where it cannot be told.
        bias: (C, 2) median, px.
    """

    scale: Floats
    bias: Floats


def camera_errors(cameras: Cameras, points: Floats, places: Floats) -> CameraErrors:
    """How far points (T, C, K, 2) are from the projections of places (T, K, 3) that were made of them.

    Of each point's error, of variance s^2 in both directions, a place that n cameras at one height tell leaves a share of
    v = 1 - 1 / n along the vertical and of h = 1 - 2 / n across it: two cameras agree in all but one direction. So the squared
    length of what remains is (v + h) s^2 times a chi-squared variable over its k degrees of freedom, whose median tells s;
    k = (v + h)^2 / (v^2 + h^2) (Welch and Satterthwaite).
    """
    projected = np.moveaxis(np.asarray(project(cameras, jnp.asarray(np.nan_to_num(places), float)), np.float64), 0, 1)
    count = np.maximum(np.isfinite(points).all(-1).sum(1), 2)
    share, freedom = 2 - 3 / count, (2 - 3 / count) ** 2 / ((1 - 1 / count) ** 2 + (1 - 2 / count) ** 2)
    unit = share * scipy.stats.chi2.median(freedom) / freedom
    residual = np.where(np.isfinite(places)[:, None, :, :1], points - projected, np.nan)
    squared = np.sum(residual**2, -1) / unit[:, None]
    scale, bias = np.full(points.shape[1], np.nan), np.zeros((points.shape[1], 2))
    for c in range(points.shape[1]):
        seen = np.isfinite(squared[:, c])
        if seen.sum() >= MIN_RESIDUALS:
            scale[c] = np.sqrt(np.median(squared[:, c][seen]))
            bias[c] = np.median(residual[:, c][seen], 0)
    return CameraErrors(scale, bias)
