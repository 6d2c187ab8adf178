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
