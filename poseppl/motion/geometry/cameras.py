"""Calibrated perspective cameras with lens distortion, one or several, behind one interface.

A world point p (mm) has camera coordinates ``R (p - centre)``, with the optical axis along the camera's z. The image point is
``focal * distort(x / z, y / z) + principal``, in the camera's units. These are pixels for a calibrated camera, and pure numbers
for the camera of Choo and Fleet 2001 (Eq. 18). That camera has its optical axis along the world's Y axis, image x along X and
image y along Z. Distortion is one of :mod:`poseppl.motion.geometry.lenses`, as in OpenCV.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.lenses import distort

NEAREST = 1.0
"""Depth (mm) to which a point at or behind the camera is moved, so that projections and gradients stay finite."""


class Cameras(NamedTuple):
    """C cameras: ``rotation`` (C, 3, 3) world to camera, ``centre`` (C, 3) mm, ``focal`` and ``principal`` (C, 2).

    ``distortion`` is (C, 5), (C, 8), (C, 9), see :mod:`~poseppl.motion.geometry.lenses`, or None, which costs nothing.
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
