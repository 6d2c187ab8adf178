"""Small errors of the cameras' places and directions, from what several of them see of one person.

The most likely poses of the cameras are sought under a prior of 1 degree and 30 mm around the calibration, and a Student-t
error of the points (4 degrees of freedom): each point's place is the one nearest to its rays, and what remains between its
projections and what was seen is made small. A detector's errors last: those of one point stay alike for about a second, so
that all frames of a second count as one. The posterior of the poses is Laplace's: Gaussian, with the curvature of the sum of
squares.
Its prior is as wide as the errors that were found are large, four of the first prior's size beside them (MacKay 1992,
doi:10.1162/neco.1992.4.3.415): errors that all cameras share, which no data show, are as large as those that the data show.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras, project
from poseppl.motion.geometry.cameras import nearest_points, viewing_rays
from poseppl.stored_programs import stored_jit

PRIOR_ANGLE, PRIOR_POSITION = np.deg2rad(1.0), 30.0
"""Standard deviations of a camera's turn about each axis (radians) and of its centre along each (mm)."""
PRIOR_WEIGHT = 4.0
"""How many errors of the prior's size count beside those that were found, for the width of the posterior's prior; ours."""
MAX_FRAMES = 50
"""Frames at most, evenly spaced, that the poses are sought in."""
ERRORS_LAST = 1.0
"""Seconds after which the errors of a point are others."""
_FREEDOM = 4.0
_STEP = 0.03
"""Step of the difference quotients, in standard deviations of the prior; projections have seven digits."""


class RefinedCameras(NamedTuple):
    """Cameras and how they differ from the calibration.

    Attributes:
        cameras: C cameras.
        turn: (C, 3) rotation vector in the camera's axes, radians.
        shift: (C, 3) of the centre, mm.
        turn_deviation: (C, 3) standard deviation of the turn.
        shift_deviation: (C, 3) of the shift.
        covariance: (6 C, 6 C) of turn and shift, of one camera after the other.
    """

    cameras: Cameras
    turn: Floats
    shift: Floats
    turn_deviation: Floats
    shift_deviation: Floats
    covariance: Floats


def bundle_adjust(cameras: Cameras, points: Floats, confidence: Floats, noise: float, rate: float) -> RefinedCameras:
    """Find small errors of calibrated cameras.

    Args:
        cameras: C cameras, two at least.
        points: (T, C, K, 2), NaN where a point was not seen.
        confidence: (T, C, K).
        noise: Standard deviation of a coordinate without the errors, px.
        rate: Frames a second.
    """
    rows = np.unique(np.linspace(0, len(points) - 1, min(MAX_FRAMES, len(points))).astype(int))
    independent = min(1.0, max(1.0, len(points) / rate / ERRORS_LAST) / len(rows))
    points, weights = points[rows], np.where(np.isfinite(points[rows]).all(-1), confidence[rows], 0.0)
    weights = np.where((weights > 0).sum(1, keepdims=True) >= 2, weights, 0.0)
    count = cameras.centre.shape[0]
    scale = np.repeat([PRIOR_ANGLE, PRIOR_POSITION], 3)
    rays = np.stack([viewing_rays(cameras, c, points[:, c]) for c in range(count)], 1)
    seen = np.asarray(np.where(np.isfinite(points), points, 0.0))

    def residuals(flat: Floats) -> Floats:
        errors = flat.reshape(count, 6) * scale
        moved = _moved(cameras, errors)
        turned = np.einsum("cij,tckj->tcki", _world_turns(cameras, moved), rays)
        places = nearest_points(np.asarray(moved.centre, np.float64), turned, weights)
        projected = np.moveaxis(np.asarray(_project(moved, jnp.asarray(np.nan_to_num(places), float)), np.float64), 0, 1)
        off = (projected - seen) * np.sqrt(weights)[..., None] / noise
        # the root of a t density's -2 log is the residual of a sum of squares
        robust = np.sign(off) * np.sqrt((_FREEDOM + 1) * np.log1p(off**2 / _FREEDOM))
        return np.concatenate([np.sqrt(independent) * robust[weights > 0].ravel(), flat])

    def derivative(flat: Floats) -> Floats:
        steps = _STEP * np.eye(flat.size)
        return np.stack([(residuals(flat + step) - residuals(flat - step)) / (2 * _STEP) for step in steps], -1)

    found = scipy.optimize.least_squares(
        residuals, np.zeros(6 * count), jac=derivative, method="trf", xtol=1e-4, ftol=1e-5, max_nfev=20
    )
    unit = np.tile(scale, count)
    information, eye = found.jac.T @ found.jac - np.eye(found.x.size), np.eye(found.x.size)
    squared = (PRIOR_WEIGHT + found.x @ found.x) / (PRIOR_WEIGHT + np.trace(information @ np.linalg.inv(information + eye)))
    covariance = np.linalg.inv(information + eye / squared) * np.outer(unit, unit)
    deviation = np.sqrt(np.diag(covariance)).reshape(count, 6)
    errors = found.x.reshape(count, 6) * scale
    return RefinedCameras(_moved(cameras, errors), errors[:, :3], errors[:, 3:], deviation[:, :3], deviation[:, 3:], covariance)


_project = stored_jit(project)


def _moved(cameras: Cameras, errors: Floats) -> Cameras:
    turns = Rotation.from_rotvec(errors[:, :3]).as_matrix()
    rotation = np.einsum("cij,cjk->cik", turns, np.asarray(cameras.rotation, np.float64))
    centre = np.asarray(cameras.centre, np.float64) + errors[:, 3:]
    return cameras._replace(rotation=jnp.asarray(rotation, float), centre=jnp.asarray(centre, float))


def _world_turns(cameras: Cameras, moved: Cameras) -> Floats:
    """(C, 3, 3) what takes a ray of the calibrated camera to the same pixel's ray of the moved one."""
    old, new = np.asarray(cameras.rotation, np.float64), np.asarray(moved.rotation, np.float64)
    return np.asarray(np.einsum("cji,cjk->cik", new, old))
