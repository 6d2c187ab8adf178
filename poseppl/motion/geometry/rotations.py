"""Rotation matrices: about the coordinate axes, from Euler angles (Eq. 19 of Choo and Fleet 2001) and from rotation vectors.

``X_parent = R_Z(gamma) R_Y(beta) R_X(alpha) X_child``; angles in radians.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp

_NEXT = {"X": (0, 1, 2), "Y": (1, 2, 0), "Z": (2, 0, 1)}


def rotation_about(axis: str, angle: jax.Array) -> jax.Array:
    """Rotate about one coordinate axis.

    Args:
        axis: "X", "Y" or "Z".
        angle: Radians, any shape.

    Returns:
        Matrices of shape (..., 3, 3).
    """
    i, j, k = _NEXT[axis]
    angle = jnp.asarray(angle)
    cosine, sine, one = jnp.cos(angle), jnp.sin(angle), jnp.ones_like(angle)
    zero = jnp.zeros_like(angle)
    rows = [[zero] * 3 for _ in range(3)]
    rows[i][i], rows[j][j], rows[k][k], rows[j][k], rows[k][j] = one, cosine, cosine, -sine, sine
    return jnp.stack([jnp.stack(row, -1) for row in rows], -2)


def rotation_zyx(angles: jax.Array) -> jax.Array:
    """Compose R_Z R_Y R_X (Eq. 19).

    Args:
        angles: Shape (..., 3): about Z, Y and X, in radians.

    Returns:
        Matrices of shape (..., 3, 3) that map child to parent coordinates.
    """
    about_z, about_y, about_x = (rotation_about(axis, angles[..., i]) for i, axis in enumerate("ZYX"))
    return about_z @ about_y @ about_x


def zyx_angles(rotation: jax.Array) -> jax.Array:
    """Recover the angles of :func:`rotation_zyx`, with the Y angle in [-pi/2, pi/2].

    Args:
        rotation: Shape (..., 3, 3).

    Returns:
        Shape (..., 3): about Z, Y and X. At the gimbal lock (Y angle of +-pi/2) the X angle is arbitrary.
    """
    about_z = jnp.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    about_y = jnp.arctan2(-rotation[..., 2, 0], jnp.hypot(rotation[..., 0, 0], rotation[..., 1, 0]))
    about_x = jnp.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    return jnp.stack([about_z, about_y, about_x], -1)


def rotation_from_vector(vector: jax.Array) -> jax.Array:
    """Rodrigues' formula: the rotation by ``|vector|`` radians about the direction of ``vector``.

    Args:
        vector: Shape (..., 3), radians.

    Returns:
        Matrices of shape (..., 3, 3); differentiable at zero.
    """
    squared = jnp.sum(vector * vector, -1)[..., None, None]
    small = squared < 1e-6  # below, the series is exact to rounding; above, the quotients are safe
    angle = jnp.sqrt(jnp.where(small, 1.0, squared))  # the dummy keeps the gradient of the unused branch finite
    first = jnp.where(small, 1 - squared / 6 + squared**2 / 120, jnp.sin(angle) / angle)
    half = jnp.sin(angle / 2) / angle
    second = jnp.where(small, 0.5 - squared / 24 + squared**2 / 720, 2 * half**2)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = jnp.zeros_like(x)
    cross = jnp.stack([jnp.stack([zero, -z, y], -1), jnp.stack([z, zero, -x], -1), jnp.stack([-y, x, zero], -1)], -2)
    return jnp.eye(3, dtype=vector.dtype) + first * cross + second * (cross @ cross)
