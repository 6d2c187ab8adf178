"""Small synthetic images of a known pose: cameras around a body, its silhouette and edges, made by plain NumPy."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from oracles.plain_outlines import camera_of, cones_of, outline, silhouette

from poseppl.motion.geometry import join_cameras, look_at
from poseppl.motion.geometry.flesh import part_frames

HEIGHT, WIDTH, STRIDE = 120, 160, 2
FOCAL = 210.0


def cameras(count=3):
    views = []
    for k in range(count):
        angle = 2 * np.pi * k / count + 0.3
        view = look_at((3500 * np.sin(angle), -3500 * np.cos(angle), 1200), (0, 0, 900), FOCAL)
        views.append(view._replace(principal=jnp.array([[79.5, 59.5]])))
    return join_cameras(views)


def cones(body, state):
    return cones_of(body.flesh, part_frames(body.tree, body.flesh, jnp.asarray(state, float)))


def outlines(body, state, view):
    """Corners of each part in each camera: a list of lists."""
    return [[outline(camera_of(view, c), cone) for cone in cones(body, state)] for c in range(len(view.centre))]


def masks(body, state, view, stride=1):
    """Silhouettes (C, rows, columns) on every ``stride``-th pixel."""
    rows, columns = (np.arange(stride // 2, size, stride) for size in (HEIGHT, WIDTH))
    placed = cones(body, state)
    return np.stack([silhouette(camera_of(view, c), placed, rows, columns) for c in range(len(view.centre))])


def edges(body, state, view):
    """Pixels within 0.8 px of a part's side (C, H, W)."""
    found = np.zeros((len(view.centre), HEIGHT, WIDTH), bool)
    for c, parts in enumerate(outlines(body, state, view)):
        for corners in parts:
            for start, end in ((corners[0], corners[1]), (corners[2], corners[3])):
                for t in np.linspace(0, 1, 200):
                    column, row = np.round(start + t * (end - start)).astype(int)
                    if 0 <= row < HEIGHT and 0 <= column < WIDTH:
                        found[c, row, column] = True
    return found


def true_pose(body):
    """A step with bent arms: no two parts in line."""
    state = np.array(body.rest, float)
    turns = {
        ("hip_l", "X"): 0.5,
        ("hip_r", "X"): -0.3,
        ("elbow_l", "X"): 0.9,
        ("shoulder_r", "X"): -0.4,
        ("shoulder_l", "Y"): 0.5,
    }
    for index, coordinate in enumerate(body.tree.coordinates):
        state[index] += turns.get(coordinate, 0.0)
    return state
