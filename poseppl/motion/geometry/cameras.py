"""Calibrated perspective cameras with lens distortion behind one interface, and places in space from what several see.

A world point p (mm) has camera coordinates ``R (p - centre)``, with the optical axis along the camera's z. The image point is
``focal * distort(x / z, y / z) + principal``, in the camera's units. These are pixels for a calibrated camera, and pure numbers
for the camera of Choo and Fleet 2001 (Eq. 18). That camera has its optical axis along the world's Y axis, image x along X and
image y along Z. Distortion is as in OpenCV.

A point u, v of the plane at depth 1, with s = u^2 + v^2, is moved as OpenCV has it, by the number of a camera's coefficients:

* 5, of Brown and Conrady: (k1, k2, p1, p2, k3), radial by 1 + k1 s + k2 s^2 + k3 s^3, and tangential by p1 and p2;
* 8, the rational model: (k1, k2, p1, p2, k3, k4, k5, k6), where that is divided by 1 + k4 s + k5 s^2 + k6 s^3;
* 9, where some cameras are fisheyes: the ninth is 1 for these, whose first four (k1 to k4) are those of Kannala and Brandt
  (2006, doi:10.1109/TPAMI.2006.153): at an angle t from the axis, a point is at t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8);
  and 0 for the others, with the eight of above.

The forms are written with operators alone where they can be, so that JAX and NumPy share them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats

NEAREST = 1.0
"""Depth (mm) to which a point at or behind the camera is moved, so that projections and gradients stay finite."""


class Cameras(NamedTuple):
    """C cameras: ``rotation`` (C, 3, 3) world to camera, ``centre`` (C, 3) mm, ``focal`` and ``principal`` (C, 2).

    ``distortion`` is (C, 5), (C, 8), (C, 9), see :mod:`~poseppl.motion.geometry.cameras`, or None, which costs nothing.
    """

    rotation: Array
    centre: Array
    focal: Array
    principal: Array
    distortion: Array | None = None


def paper_camera(centre: Sequence[float]) -> Cameras:
    """Build the camera of Choo and Fleet 2001, Eq. 18: focal length 1, optical axis along +Y, image y up.

    Args:
        centre: (X_c, Y_c, Z_c) in mm.
    """
    rotation = jnp.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]])
    return Cameras(rotation, jnp.array([centre], float), jnp.array([[1.0, -1.0]]), jnp.zeros((1, 2)))


def look_at(centre: Sequence[float], target: Sequence[float], focal: float = 1.0) -> Cameras:
    """Point a level camera at a target, image y up as in Eq. 18; with ``target`` due +Y of ``centre`` it is the paper's.

    Args:
        centre: Camera centre, mm.
        target: A point on the optical axis, mm; not straight above or below the centre.
        focal: Focal length in image units.
    """
    forward = jnp.array(target, float) - jnp.array(centre, float)
    forward = forward / jnp.linalg.norm(forward)
    right = jnp.cross(forward, jnp.array([0.0, 0.0, 1.0]))
    right = right / jnp.linalg.norm(right)
    rotation = jnp.stack([right, jnp.cross(forward, right), forward])
    return Cameras(rotation[None], jnp.array([centre], float), jnp.array([[focal, -focal]]), jnp.zeros((1, 2)))


def join_cameras(cameras: Sequence[Cameras]) -> Cameras:
    """Stack camera sets into one; where only some have distortion, or fewer coefficients, the others get zeros."""
    width = max((0 if camera.distortion is None else camera.distortion.shape[1] for camera in cameras), default=0)
    if width:
        cameras = [camera._replace(distortion=_padded(camera, width)) for camera in cameras]
    joined: Cameras = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *cameras)
    return joined


def _padded(cameras: Cameras, width: int) -> Array:
    """The coefficients (C, width), zeros where there are none."""
    own = jnp.zeros((cameras.centre.shape[0], 0)) if cameras.distortion is None else cameras.distortion
    return jnp.pad(own, ((0, 0), (0, width - own.shape[1])))


def moved_cameras(cameras: Cameras, turn: Array, shift: Array) -> Cameras:
    """Cameras turned by rotation vectors (C, 3), radians, in their own axes, and moved by (C, 3), mm, in the world.

    Rodrigues' formula; a turn of none is a series, so that derivatives are finite there.
    """
    squared = jnp.sum(turn**2, -1)[:, None, None]
    small = squared < 1e-8
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))
    sine = jnp.where(small, 1 - squared / 6, jnp.sin(angle) / angle)
    cosine = jnp.where(small, 0.5 - squared / 24, (1 - jnp.cos(angle)) / angle**2)
    x, y, z = jnp.moveaxis(turn, -1, 0)
    nothing = jnp.zeros_like(x)
    cross = jnp.stack([nothing, -z, y, z, nothing, -x, -y, x, nothing], -1).reshape(-1, 3, 3)
    rotation = jnp.eye(3) + sine * cross + cosine * cross @ cross
    return cameras._replace(rotation=rotation @ cameras.rotation, centre=cameras.centre + shift)


def project(cameras: Cameras, points: Array) -> Array:
    """Project world points into every camera.

    Args:
        cameras: C cameras.
        points: Shape (..., 3), mm.

    Returns:
        Image points of shape (C, ..., 2), in the cameras' image units.
    """
    shape = (-1,) + (1,) * (points.ndim - 1)
    spread = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1).reshape(*leaf.shape[1:], *shape), cameras)
    u, v = project_components(spread, points[None, ..., 0], points[None, ..., 1], points[None, ..., 2])
    return jnp.stack([u, v], -1)


def depth(cameras: Cameras, points: Array) -> Array:
    """Distance along the optical axis (mm), positive in front: points (..., 3) give (C, ...)."""
    offset = points[None] - cameras.centre.reshape(-1, *(1,) * (points.ndim - 1), 3)
    return jnp.einsum("ci,c...i->c...", cameras.rotation[:, 2], offset)


def beside_points(cameras: Cameras) -> Cameras:
    """Cameras (C, ..., N) laid out for :func:`project_components` of points (C, P, K, N): leaves (..., C, 1, 1, N)."""
    spread: Cameras = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2)[..., None, None, :], cameras)
    return spread


def project_components(camera: Cameras, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Project component by component: fields of ``camera`` with their matrix axes first, all else broadcast.

    Args:
        camera: ``rotation`` (3, 3, ...), ``centre`` (3, ...), ``focal`` (2, ...) and so on.
        x: World coordinates in mm, of any shape that broadcasts with the fields.
        y: Likewise.
        z: Likewise.
    """
    rotation, centre = camera.rotation, camera.centre
    x, y, z = x - centre[0], y - centre[1], z - centre[2]
    a, b, c = (rotation[i, 0] * x + rotation[i, 1] * y + rotation[i, 2] * z for i in range(3))
    inverse = 1.0 / jnp.maximum(c, NEAREST)
    u, v = a * inverse, b * inverse
    if camera.distortion is not None:
        u, v = distort(camera.distortion, u, v)
    return camera.focal[0] * u + camera.principal[0], camera.focal[1] * v + camera.principal[1]


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


def viewing_rays(cameras: Cameras, camera: int, points: Floats) -> Floats:
    """Unit directions (..., 3) in the world of the rays of one camera's image points (..., 2).

    NaN where a point is, and where its lens puts nothing (:func:`~poseppl.motion.geometry.cameras.undistort`).
    """
    lens = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64)[camera], cameras)
    plane = (points - lens.principal) / lens.focal
    if lens.distortion is not None:
        plane = undistort(lens.distortion, plane)
    ray = np.concatenate([plane, np.ones_like(plane[..., :1])], -1) @ lens.rotation
    return np.asarray(ray / np.linalg.norm(ray, axis=-1, keepdims=True))


def ray_distances(first: Floats, first_rays: Floats, second: Floats, second_rays: Floats) -> Floats:
    """Shortest distances (..., K), mm, between lines from two centres (..., 3) along unit directions (..., K, 3) each."""
    normal = np.cross(first_rays, second_rays)
    return np.asarray(
        np.abs((normal @ (second - first)[..., None])[..., 0]) / np.maximum(np.linalg.norm(normal, axis=-1), 1e-9)
    )


def nearest_points(centres: Floats, rays: Floats, weights: Floats) -> Floats:
    """The points with the least weighted sum of squared distances to rays.

    Args:
        centres: (C, 3) mm.
        rays: Unit directions (..., C, K, 3).
        weights: (..., C, K), 0 where a ray does not count.

    Returns:
        (..., K, 3) mm; NaN where fewer than two rays count.
    """
    counts = weights > 0
    rays = np.where(counts[..., None], rays, 0.0)
    across = weights[..., None, None] * (np.eye(3) - rays[..., :, None] * rays[..., None, :])
    matrix = across.sum(-4)
    right = np.einsum("...ckij,cj->...ki", across, centres)
    known = counts.sum(-2) >= 2
    matrix = np.where(known[..., None, None], matrix + 1e-12 * np.eye(3), np.eye(3))
    places = np.linalg.solve(matrix, right[..., None])[..., 0]
    return np.asarray(np.where(known[..., None], places, np.nan))


def triangulate(cameras: Cameras, points: Floats, confidence: Floats) -> Floats:
    """Places (T, K, 3), mm, of points (T, C, K, 2) that two cameras see, weighted by confidence; NaN elsewhere."""
    rays = np.stack([viewing_rays(cameras, c, points[:, c]) for c in range(points.shape[1])], 1)
    weights = np.where(np.isfinite(points).all(-1), confidence, 0.0)
    return nearest_points(np.asarray(cameras.centre, np.float64), rays, weights)
