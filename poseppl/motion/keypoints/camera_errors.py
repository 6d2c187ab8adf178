"""Noise and bias of each camera's points, from their distances to the triangulated positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtri

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.recorded_frames import image_points

MIN_RESIDUALS = 30
"""Minimum number of a camera's points to estimate its errors."""


class CameraErrors(NamedTuple):
    """Noise and bias of each camera's points, from their distances to the triangulated positions.

    Attributes:
        scale: (C,) standard deviation of a coordinate, px, bias included; NaN where it cannot be estimated.
        bias: (C, 2) median, px.
    """

    scale: Floats
    bias: Floats


def camera_errors(cameras: Cameras, points: Floats, places: Floats) -> CameraErrors:
    """Estimate noise and bias of points (T, C, K, 2) from the projections of positions (T, K, 3) triangulated from them.

    Let a point's error have the variance s^2 in both directions. The residual to a position triangulated from n cameras at one
    height has the share v = 1 - 1 / n of this variance along the vertical and h = 1 - 2 / n across it: two cameras agree in all
    but one direction. So the squared length of a residual is (v + h) s^2 times a chi-squared variable over its k degrees of
    freedom, with k = (v + h)^2 / (v^2 + h^2) (Welch and Satterthwaite). Its median estimates s.
    """
    projected = np.moveaxis(image_points(cameras, np.nan_to_num(places)), 0, 1)
    count = np.maximum(np.isfinite(points).all(-1).sum(1), 2)
    share, freedom = 2 - 3 / count, (2 - 3 / count) ** 2 / ((1 - 1 / count) ** 2 + (1 - 2 / count) ** 2)
    unit = share * chdtri(freedom, 0.5) / freedom
    residual = np.where(np.isfinite(places)[:, None, :, :1], points - projected, np.nan)
    squared = np.sum(residual**2, -1) / unit[:, None]
    scale, bias = np.full(points.shape[1], np.nan), np.zeros((points.shape[1], 2))
    for c in range(points.shape[1]):
        seen = np.isfinite(squared[:, c])
        if seen.sum() >= MIN_RESIDUALS:
            scale[c] = np.sqrt(np.median(squared[:, c][seen]))
            bias[c] = np.median(residual[:, c][seen], 0)
    return CameraErrors(scale, bias)
