"""Superquadrics of random shapes on a joint that moves freely."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from cone_views import TREE, last, pose

from poseppl.motion.geometry.superquadrics import Superquadric, local_nodes


def random_part(rng):
    """Boxy to pointed, tapered, bent, up to four times as long as wide."""
    width = rng.uniform(50, 150)
    return Superquadric(
        "part",
        "hip",
        (width, width * rng.uniform(0.6, 1.0), width * rng.uniform(0.9, 4.0)),
        tuple(rng.uniform(0.3, 1.7, 2)),
        tuple(rng.uniform(-0.4, 0.4, 2)),
        rng.uniform(0, 0.7),
        rng.uniform(0, 2 * np.pi),
        tuple(rng.normal(0, 30, 3)),
        tuple(rng.normal(size=3)),
    )


@jax.jit
def placed_nodes(flesh, latitudes, longitudes):
    return local_nodes(last(flesh), latitudes, longitudes)


def local_points(flesh, latitudes, longitudes):
    """Points (R, W, 3) of one part in its frame."""
    return np.asarray(placed_nodes(flesh, jnp.asarray(latitudes), jnp.asarray(longitudes)).points)[0, ..., 0]


def frame_of(part, state):
    """Its axes as columns (3, 3) and its centre (3,) in the world, by the book: the joint turns by R_Z R_Y R_X."""
    turns = []
    for axis, angle in zip((2, 1, 0), state[3:], strict=True):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        turns.append(turn)
    joint = turns[0] @ turns[1] @ turns[2]
    z = np.array(part.axis, float) / np.linalg.norm(part.axis)
    x = np.array(part.across, float)
    x -= z * (z @ x)
    x /= np.linalg.norm(x)
    return joint @ np.stack([x, np.cross(z, x), z], 1), np.asarray(state[:3]) + joint @ np.array(part.centre)


__all__ = ["TREE", "frame_of", "last", "local_points", "placed_nodes", "pose", "random_part"]
