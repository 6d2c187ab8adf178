"""EKS, the ensemble Kalman smoother of several calibrated cameras: with one network's points, and with the noise measured here.

It takes the variance of a point from an ensemble of networks. There is one detector here, for which it assumes a variance of
1 / confidence px^2 by itself ("one network"). "Noise measured" gives it three members, a point and one to each side of it.
Their variance over the confidence is the squared noise that poseppl measures in the same cameras. It takes no missing points:
they are interpolated between frames, with a confidence of 0.001. Its posterior has variances of x, y and z alone, whose draws
are taken for independent.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from aniposelib.cameras import Camera, CameraGroup
from eks.marker_array import MarkerArray
from eks.multicam_smoother import ensemble_kalman_smoother_multicam
from given import Answer, Given, from_standard_normal
from scipy.spatial.transform import Rotation

NAME, PACKAGE = "EKS", "ensemble-kalman-smoother"
UNSEEN = 1e-3
logging.disable(logging.INFO)


def interpolated(points: Any) -> Any:
    """Points (T, ...) with NaN filled between frames."""
    flat = points.reshape(len(points), -1).copy()
    when = np.arange(len(flat))
    for column in flat.T:
        known = np.isfinite(column)
        column[~known] = np.interp(when[~known], when[known], column[known])
    return flat.reshape(points.shape)


def members(given: Given, *, measured: bool) -> Any:
    """The ensemble (M, C, T, K, 3) of x, y and confidence."""
    seen = np.isfinite(given.points).all(-1)
    confidence = np.where(seen, given.confidence, UNSEEN)
    points = interpolated(given.points)
    if measured:
        noise = np.where(seen, given.noise, 1e3)[..., None]
        aside = noise * np.sqrt(1.5 * confidence)[..., None]  # so that the variance over the confidence is noise^2
        points = np.stack([points - aside, points, points + aside])
    else:
        points = points[None]
    sure = np.broadcast_to(confidence[..., None], (*points.shape[:-1], 1))
    return np.moveaxis(np.concatenate([points, sure], -1), 1, 2)


def methods(given: Given) -> dict[str, Callable[[], Answer]]:
    """Methods that are compared."""
    names, cameras = [str(name) for name in given.names], [f"cam{number}" for number in given.cameras]
    turns = [Rotation.from_matrix(turn).as_rotvec() for turn in given.rotation]
    group = CameraGroup(
        [
            Camera(given.matrix[c], given.distortion[c], tuple(given.size[c]), turns[c], given.translation[c], name)
            for c, name in enumerate(cameras)
        ]
    )

    def smoothed(measured: bool) -> Answer:
        ensemble = MarkerArray(members(given, measured=measured), data_fields=["x", "y", "likelihood"])
        table = ensemble_kalman_smoother_multicam(ensemble, names, cameras, camgroup=group)[-1]["ensemble-kalman_tracker"]
        mean = np.stack([table[name][["x", "y", "z"]].to_numpy(float) for name in names], 1)
        variance = np.stack([table[name][[f"{axis}_posterior_var" for axis in "xyz"]].to_numpy(float) for name in names], 1)
        return Answer(mean, from_standard_normal(mean, np.sqrt(variance)[..., None] * np.eye(3)))

    return {"one network": partial(smoothed, False), "noise measured": partial(smoothed, True)}
