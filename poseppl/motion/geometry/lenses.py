"""Lenses: what bends the image plane of a pinhole camera, and its inverse.

A point u, v of the plane at depth 1, with s = u^2 + v^2, is moved as OpenCV has it, by the number of a camera's coefficients:

* 5, of Brown and Conrady: (k1, k2, p1, p2, k3), radial by 1 + k1 s + k2 s^2 + k3 s^3, and tangential by p1 and p2;
* 8, the rational model: (k1, k2, p1, p2, k3, k4, k5, k6), where that is divided by 1 + k4 s + k5 s^2 + k6 s^3;
* 9, where some cameras are fisheyes: the ninth is 1 for these, whose first four (k1 to k4) are those of Kannala and Brandt
(2006,
  doi:10.1109/TPAMI.2006.153): at an angle t from the axis, a point is at t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8); and 0
  for the others, with the eight of above.

The forms are written with operators alone where they can be, so that JAX and NumPy share them.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats

_SMALL = 1e-8
"""Squared distance from the axis below which an angle equals its tangent in float32."""
_ROUNDS = 30
_CLOSE = 1e-10


def distort(coefficients: Any, u: Any, v: Any, xp: Any = jnp) -> tuple[Any, Any]:
    """Distort points of the plane at depth 1 as a lens does.

    Args:
        coefficients: (5, ...), (8, ...) or (9, ...), see above.
        u: First coordinate, of any shape that broadcasts with the coefficients'.
        v: Second coordinate.
        xp: Whose arrays these are: ``jax.numpy`` or ``numpy``.
    """
    if len(coefficients) < 9:
        return _brown(coefficients, u, v)
    is_fisheye = coefficients[8] > 0.5
    bent = _brown(xp.where(is_fisheye, 0.0, xp.asarray(coefficients[:8])), u, v)
    ratio = _fisheye_ratio(coefficients[:4], u * u + v * v, xp)
    return xp.where(is_fisheye, ratio * u, bent[0]), xp.where(is_fisheye, ratio * v, bent[1])


def _brown(coefficients: Any, u: Any, v: Any) -> tuple[Any, Any]:
    k1, k2, p1, p2, k3 = coefficients[:5]
    squared = u * u + v * v
    radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
    if len(coefficients) >= 8:
        k4, k5, k6 = coefficients[5:8]
        radial = radial / (1.0 + squared * (k4 + squared * (k5 + squared * k6)))
    cross = u * v
    return (
        u * radial + 2.0 * p1 * cross + p2 * (squared + 2.0 * u * u),
        v * radial + p1 * (squared + 2.0 * v * v) + 2.0 * p2 * cross,
    )


def _fisheye_ratio(coefficients: Any, squared: Any, xp: Any) -> Any:
    """How far out a fisheye puts a point, as a share of its distance from the axis."""
    k1, k2, k3, k4 = coefficients
    away = squared > _SMALL
    radius = xp.sqrt(xp.where(away, squared, 1.0))
    angle = xp.where(away, xp.arctan(radius), 0.0)
    square = angle * angle
    bent = angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
    return xp.where(away, bent / radius, 1.0)


def undistort(coefficients: Floats, plane: Floats) -> Floats:
    """Points (..., 2) of the plane at depth 1 that a lens puts where ``plane`` is, by Newton's method in float64.

    Args:
        coefficients: (5,), (8,) or (9,) of one camera.
        plane: (..., 2) distorted points.

    Returns:
        (..., 2); NaN where the lens puts no point there, or none was found.
    """
    if len(coefficients) == 9 and coefficients[8] > 0.5:
        return _undistort_fisheye(coefficients[:4], plane)
    k1, k2, p1, p2, k3, k4, k5, k6 = np.append(coefficients[:8], np.zeros(8 - len(coefficients[:8])))
    seen = np.asarray(plane, np.float64)
    u, v = seen[..., 0].copy(), seen[..., 1].copy()
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            squared = u * u + v * v
            above, below = (1 + squared * (a + squared * (b + squared * c)) for a, b, c in ((k1, k2, k3), (k4, k5, k6)))
            slopes = (a + squared * (2 * b + 3 * squared * c) for a, b, c in ((k1, k2, k3), (k4, k5, k6)))
            above_slope, below_slope = slopes
            radial = above / below
            slope = (above_slope - radial * below_slope) / below
            off_u = u * radial + 2 * p1 * u * v + p2 * (squared + 2 * u * u) - seen[..., 0]
            off_v = v * radial + p1 * (squared + 2 * v * v) + 2 * p2 * u * v - seen[..., 1]
            along = radial + 2 * u * u * slope + 2 * p1 * v + 6 * p2 * u
            across = 2 * u * v * slope + 2 * p1 * u + 2 * p2 * v
            beside = radial + 2 * v * v * slope + 6 * p1 * v + 2 * p2 * u
            determinant = along * beside - across * across
            before = u, v
            u = u - (beside * off_u - across * off_v) / determinant
            v = v - (along * off_v - across * off_u) / determinant
            if np.array_equal(before, (u, v), equal_nan=True):  # so would all further rounds
                break
        bent = np.stack(_brown(np.array([k1, k2, p1, p2, k3, k4, k5, k6]), u, v), -1)
        found = np.stack([u, v], -1)
        # Newton may end beyond a fold, where the model folds the plane over.
        right = (np.abs(bent - seen).max(-1) <= _CLOSE * (1 + np.abs(seen).max(-1))) & (determinant > 0) & (radial > 0)
    return np.asarray(np.where(right[..., None], found, np.nan))


def _undistort_fisheye(coefficients: Floats, plane: Floats) -> Floats:
    k1, k2, k3, k4 = coefficients
    seen = np.asarray(plane, np.float64)
    radius = np.linalg.norm(seen, axis=-1)
    angle = np.minimum(radius, np.pi / 2)
    with np.errstate(all="ignore"):
        for _ in range(_ROUNDS):
            square = angle * angle
            bent = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
            slope = 1 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4)))
            angle = angle - (bent - radius) / slope
        square = angle * angle
        bent = angle * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))
        right = (np.abs(bent - radius) <= _CLOSE * (1 + radius)) & (slope > 0) & (angle >= 0) & (angle < np.pi / 2)
        ratio = np.where(radius > 1e-12, np.tan(angle) / np.maximum(radius, 1e-12), 1.0)
    return np.asarray(np.where(right[..., None], seen * ratio[..., None], np.nan))
