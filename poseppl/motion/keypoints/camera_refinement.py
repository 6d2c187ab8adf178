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

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import nearest_points, viewing_rays
from poseppl.motion.geometry.recorded_frames import image_points, image_slopes, image_slopes_by_pose

PRIOR_ANGLE, PRIOR_POSITION = np.deg2rad(1.0), 30.0
"""Standard deviations of a camera's turn about each axis (radians) and of its centre along each (mm)."""
PRIOR_WEIGHT = 4.0
"""How many errors of the prior's size count beside those that were found, for the width of the posterior's prior; ours."""
MAX_FRAMES = 50
"""Frames at most, evenly spaced, that the poses are sought in."""
ERRORS_LAST = 1.0
"""Seconds after which the errors of a point are others."""
_FREEDOM = 4.0


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
    points, counts = np.asarray(np.where(np.isfinite(points), points, 0.0)), weights > 0
    share = np.sqrt(independent)

    def seen_about(flat: Floats) -> tuple[Floats, _Met]:
        met = _met(cameras, flat.reshape(count, 6) * scale, rays, weights)
        return (np.swapaxes(image_points(met.cameras, met.places), 0, 1) - points) * np.sqrt(weights)[..., None] / noise, met

    def residuals(flat: Floats) -> Floats:
        return np.concatenate([share * _robust(seen_about(flat)[0])[0][counts].ravel(), flat])

    def derivative(flat: Floats) -> Floats:
        off, met = seen_about(flat)
        unit = np.tile(scale, count) * np.sqrt(weights)[..., None, None] / noise
        slopes = share * _robust(off)[1][..., None] * unit * _slopes(met, weights)
        return np.concatenate([slopes[counts].reshape(-1, flat.size), np.eye(flat.size)])

    found = scipy.optimize.least_squares(
        residuals, np.zeros(6 * count), jac=derivative, method="trf", xtol=1e-4, ftol=1e-5, max_nfev=20
    )
    unit = np.tile(scale, count)
    information, eye = found.jac.T @ found.jac - np.eye(found.x.size), np.eye(found.x.size)
    squared = (PRIOR_WEIGHT + found.x @ found.x) / (PRIOR_WEIGHT + np.trace(information @ np.linalg.inv(information + eye)))
    covariance = np.linalg.inv(information + eye / squared) * np.outer(unit, unit)
    deviation = np.sqrt(np.diag(covariance)).reshape(count, 6)
    errors = found.x.reshape(count, 6) * scale
    refined = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), _moved(cameras, errors))
    return RefinedCameras(refined, errors[:, :3], errors[:, 3:], deviation[:, :3], deviation[:, 3:], covariance)


class _Met(NamedTuple):
    """Cameras with errors, the rays (T, C, K, 3) of their points in the world, and the places (T, K, 3) that these pass by."""

    cameras: Cameras
    rays: Floats
    places: Floats


def _met(cameras: Cameras, errors: Floats, rays: Floats, weights: Floats) -> _Met:
    """The same with errors (C, 6); weights are (T, C, K)."""
    moved = _moved(cameras, errors)
    turned = np.einsum("cij,tckj->tcki", _world_turns(cameras, moved), rays)
    return _Met(moved, turned, np.nan_to_num(nearest_points(np.asarray(moved.centre), turned, weights)))


def _robust(off: Floats) -> tuple[Floats, Floats]:
    """The root of a t density's -2 log, which is the residual of a sum of squares, and its derivative."""
    size = np.sqrt((_FREEDOM + 1) * np.log1p(off**2 / _FREEDOM))
    slope = (_FREEDOM + 1) * np.abs(off) / (_FREEDOM + off**2) / np.maximum(size, 1e-9)
    return np.sign(off) * size, np.where(size > 1e-9, slope, np.sqrt((_FREEDOM + 1) / _FREEDOM))


def _slopes(met: _Met, weights: Floats) -> Floats:
    """Derivatives (T, C, K, 2, 6 C) of projections of places that follow the cameras, by the errors of all cameras."""
    cameras, rays, places = met
    count, by_place = rays.shape[1], np.swapaxes(image_slopes(cameras, places)[1], 0, 1)
    by_error = np.swapaxes(image_slopes_by_pose(cameras, places), 0, 1)
    across = weights[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
    across = np.where((weights > 0)[..., None, None], across, 0.0)
    inverse = np.linalg.inv(across.sum(1) + 1e-12 * np.eye(3) + (weights.sum(1) <= 0)[..., None, None] * np.eye(3))
    found = []
    for c in range(count):
        ray, lever = np.nan_to_num(rays[:, c]), np.asarray(cameras.centre)[c] - places
        turned = np.stack([-np.cross(axis, ray) for axis in np.asarray(cameras.rotation)[c]], -1)
        along = np.sum(ray * lever, -1)[..., None, None]
        bent = turned * along + ray[..., None] * (lever[..., None, :] @ turned)
        pulls = np.concatenate([-weights[:, c, :, None, None] * bent, across[:, c]], -1)
        found.append(by_place @ (inverse @ pulls)[:, None])
        found[-1][:, c] += by_error[:, c]
    return np.concatenate(found, -1)


def _moved(cameras: Cameras, errors: Floats) -> Cameras:
    turns = Rotation.from_rotvec(errors[:, :3]).as_matrix()
    rotation = np.einsum("cij,cjk->cik", turns, np.asarray(cameras.rotation, np.float64))
    centre = np.asarray(cameras.centre, np.float64) + errors[:, 3:]
    moved: Any = {"rotation": rotation, "centre": centre}
    return cameras._replace(**moved)


def _world_turns(cameras: Cameras, moved: Cameras) -> Floats:
    """(C, 3, 3) what takes a ray of the calibrated camera to the same pixel's ray of the moved one."""
    old, new = np.asarray(cameras.rotation, np.float64), np.asarray(moved.rotation, np.float64)
    return np.asarray(np.einsum("cji,cjk->cik", new, old))
