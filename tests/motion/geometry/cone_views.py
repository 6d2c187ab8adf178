"""Cones on a joint that moves freely, seen by cameras of 640 x 480 px; their silhouettes by the package and by casting rays."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from oracles.ray_casting import cone_is_hit, rays

from poseppl.motion.geometry import Joint, Marker, join_cameras, kinematic_tree, look_at, project
from poseppl.motion.geometry.coverage import hard_coverage, part_distances, project_parts
from poseppl.motion.geometry.flesh import Cone, flesh_of, parts_of

TREE = kinematic_tree([Joint("hip", None, (0, 0, 0), "ZYX")], [Marker("knee", "hip", (0, 0, 400.0))])
FOCAL, CENTRE = 600.0, (320.0, 240.0)
CONES = {
    "cylinder": Cone("cylinder", "hip", 400.0, (60.0, 60.0)),
    "tapered": Cone("tapered", "hip", 300.0, (120.0, 40.0)),
    "torso": Cone("torso", "hip", 580.0, (160.0, 160.0), (0.88, 1.0)),
    "flat": Cone("flat", "hip", 500.0, (150.0, 110.0), (1.0, 0.6), axis=(1, 2, 2), across=(0, 1, 0)),
    "backwards": Cone("backwards", "hip", -248.0, (40.0, 30.0), origin=(20.0, -30.0, 100.0)),
}


def last(tree):
    """Give every leaf a last axis of one, for functions that are written for a batch there."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], tree)


def camera(distance, elevation=0.3, turn=0.0, distortion=None):
    """One that looks at the origin from a distance, mm, and angles above the ground and about the vertical."""
    flat = distance * np.cos(elevation)
    seen = look_at((flat * np.sin(turn), -flat * np.cos(turn), distance * np.sin(elevation)), (0, 0, 0))
    bent = None if distortion is None else jnp.array([distortion])
    return seen._replace(focal=jnp.array([[FOCAL, FOCAL]]), principal=jnp.array([CENTRE]), distortion=bent)


def four_cameras(distance=4000.0):
    return join_cameras([camera(distance, 0.3, turn) for turn in (0.0, 1.5, 3.1, 4.6)])


def pose(rng, spread=60.0):
    """A state: place within ``spread`` mm or so, any rotation."""
    return np.r_[rng.normal(0, spread, 3), rng.uniform(-np.pi, np.pi, 3)]


@jax.jit
def covered(view, flesh, parts, points):
    """Coverage (C, K) of points (C, K, 2)."""
    return hard_coverage(part_distances(project_parts(view, flesh, parts), points[..., None]))[..., 0]


def silhouettes(cone, state, view, side=200, window=None):
    """Coverage by the package and by rays, both (side^2,), of points around it, or around the cone ``window``."""
    flesh = flesh_of(TREE, [cone])
    parts = parts_of(last(TREE), last(flesh), jnp.asarray(state, float)[:, None])
    base, axes = np.asarray(parts.base[0, :, 0], float), np.asarray(parts.axes[0, :, :, 0], float)
    eye, turn = np.asarray(view.centre[0], float), np.asarray(view.rotation[0], float)
    around = cone if window is None else window
    reach = max(around.radii) * max(1.0, *around.scale)
    ends = np.array([base, base + axes[:, 2] * cone.length])[:, None] + reach * np.array([*np.eye(3), *-np.eye(3)])
    flat = (ends.reshape(-1, 3) - eye) @ turn.T
    flat = flat[:, :2] / flat[:, 2:]
    grid = np.stack(np.meshgrid(*np.linspace(flat.min(0), flat.max(0), side).T), -1).reshape(-1, 2)
    directions = rays(turn, 1.0, 0.0, grid)
    points = project(view, jnp.asarray(eye + 1000.0 * directions))[0]
    expected = cone_is_hit(eye, directions, axes, base, cone.length, cone.radii, cone.scale)
    return np.asarray(covered(last(view), last(flesh), parts, points[None]))[0], expected


def overlap(found, expected):
    """Intersection over union."""
    return np.sum(found & expected) / np.sum(found | expected)
