"""Superquadrics of random shapes on a joint that moves freely; their silhouettes by the package and by marching along rays."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from cone_views import TREE, last, pose
from oracles.ray_casting import rays
from oracles.superquadric_rays import part_is_hit
from poseppl_models.sminchisescu_triggs.superquadric_outlines import outlines_of, superquadric_distances
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, local_nodes, superquadrics_of

from poseppl.motion.geometry import project
from poseppl.motion.geometry.coverage import hard_coverage
from poseppl.motion.geometry.kinematics import frames_of

PIECES = 6
"""Pieces of all shapes here, so that one program serves all."""


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


def distances_of(cameras, flesh, tree, state, points):
    """Distances (C, P, K, N), all batch last."""
    return superquadric_distances(outlines_of(cameras, flesh, frames_of(tree, state)), points)


@jax.jit
def covered(view, flesh, state, points):
    """Coverage (C, K) of points (C, K, 2)."""
    return hard_coverage(distances_of(last(view), last(flesh), last(TREE), state[:, None], points[..., None]))[..., 0]


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


def silhouettes(part, state, view, side=150, wrong=None, pieces=PIECES):
    """Coverage by the package (of the part ``wrong``, if given) and by rays, both (side^2,), of points around it."""
    axes, centre = frame_of(part, state)
    eye, turn = np.asarray(view.centre[0], float), np.asarray(view.rotation[0], float)
    flesh = superquadrics_of(TREE, [part], pieces=pieces)
    nodes = local_points(flesh, *np.linspace([-np.pi / 2, 0], [np.pi / 2, 6], 12).T)
    flat = (nodes.reshape(-1, 3) @ axes.T + centre - eye) @ turn.T
    flat = flat[:, :2] / flat[:, 2:]
    low, high = flat.min(0), flat.max(0)
    margin = 0.1 * (high - low)
    grid = np.stack(np.meshgrid(*np.linspace(low - margin, high + margin, side).T), -1).reshape(-1, 2)
    directions = rays(turn, 1.0, 0.0, grid)
    points = project(view, jnp.asarray(eye + 1000.0 * directions))[0]
    shape = flesh if wrong is None else superquadrics_of(TREE, [wrong], pieces=pieces)
    found = covered(view, shape, jnp.asarray(state, float), points[None])
    return np.asarray(found)[0], part_is_hit(eye, directions, axes, centre, part)


__all__ = [
    "PIECES",
    "TREE",
    "covered",
    "distances_of",
    "frame_of",
    "last",
    "placed_nodes",
    "pose",
    "random_part",
    "silhouettes",
]
