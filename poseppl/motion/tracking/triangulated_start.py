"""Poses of all frames from several cameras, without a filter: triangulation and inverse kinematics."""

from __future__ import annotations

import numpy as np

from poseppl.arrays import Floats
from poseppl.motion.bodies.body import Body
from poseppl.motion.bodies.inverse_kinematics import fit_states
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.tracking.problem import Problem, body_inputs
from poseppl.runs.run import Constant

EVERY = 1 / 15
"""Seconds between frames whose poses are sought; the others are between them."""


def triangulated_poses(body: Body, places: Floats, seconds: Floats) -> Floats:
    """Poses (T, d) whose markers lie closest to places (T, K, 3), mm, NaN where unknown; rest decides where hinges bend to.

    Args:
        body: The body.
        places: Positions of its markers, of which some are known in a frame.
        seconds: To each frame from the one before (T,).
    """
    when = np.cumsum(seconds)
    known = np.flatnonzero(np.isfinite(places).all(-1).any(-1))
    chosen = known[np.unique(np.floor((when[known] - when[known[0]]) / EVERY), return_index=True)[1]]
    states, _ = fit_states(body.tree, places[chosen], body.rest)
    return np.stack([np.interp(when, when[chosen], column) for column in states.T], 1)


def triangulated_places(problem: Problem, points: Floats) -> Floats:
    """Places (T, K, 3), mm, of points (T, C, K, 2) that two cameras see, weighted by their noise; NaN elsewhere."""
    own = body_inputs(problem.inputs)
    noise = np.asarray(own.noise.value if isinstance(own.noise, Constant) else own.noise, np.float64)
    return triangulate(own.cameras.value, points, np.broadcast_to((noise.min() / noise) ** 2, points.shape[:-1]))
