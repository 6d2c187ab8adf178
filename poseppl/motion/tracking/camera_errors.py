"""What remains of each camera's points between them and the places that all cameras' rays pass by: noise and bias."""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, project

LEAST_RESIDUALS = 30
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

    A place takes three numbers of the two that each of n cameras has, so that the rest of a coordinate has a standard deviation
    of sqrt(1 - 3 / 2n) of its own error's.
    """
    projected = np.moveaxis(np.asarray(project(cameras, jnp.asarray(np.nan_to_num(places), float)), np.float64), 0, 1)
    count = np.isfinite(points).all(-1).sum(1)
    left = np.sqrt(np.maximum(1 - 1.5 / np.maximum(count, 1), 0.25))
    residual = np.where(np.isfinite(places)[:, None, :, :1], points - projected, np.nan)
    scale, bias = np.full(points.shape[1], np.nan), np.zeros((points.shape[1], 2))
    for c in range(points.shape[1]):
        seen = np.isfinite(residual[:, c]).all(-1)
        if seen.sum() >= LEAST_RESIDUALS:
            scale[c] = 1.4826 * np.median(np.abs(residual[:, c] / left[..., None])[seen])
            bias[c] = np.median(residual[:, c][seen], 0)
    return CameraErrors(scale, bias)
