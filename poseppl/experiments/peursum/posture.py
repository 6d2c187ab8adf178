"""The paper's error (section 5.1): the distance of the mean posture from the truth, at thirteen of the fifteen joints.

The mean posture is the weighted mean of positions and joint angles, not of places; its virtual markers stand against the true
ones (Sigal and Black 2006, Eqs. 3 to 6). The hips, the upper ends of the legs, are left out: the paper found no points on its
body that matched them well.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.diagnostics import VIRTUAL_MARKERS, virtual_markers
from poseppl.motion.geometry import KinematicTree, marker_positions
from poseppl.motion.learned.angles import mean_angle

LEFT_OUT = ("hip_l", "hip_r")
_COMPARED = [number for number, name in enumerate(VIRTUAL_MARKERS) if name not in LEFT_OUT]


def mean_posture(states: ArrayLike, weights: ArrayLike) -> Floats:
    """The weighted mean of poses: of positions, and of angles as directions, so that whole turns do not matter.

    Args:
        states: (N, d), three positions (mm) and then angles (radians).
        weights: (N,), which need not add up to 1; the state of a particle of no weight does not matter.

    Returns:
        The mean (d,).

    Raises:
        ValueError: Shapes do not match, or the weights are negative, not finite, or add up to nothing.
    """
    poses, shares = np.asarray(states, np.float64), np.asarray(weights, np.float64)
    if poses.ndim != 2 or shares.shape != poses.shape[:1]:
        raise ValueError(f"states have shape {poses.shape} and weights {shares.shape}. Expected (N, d) and (N,).")
    if not (np.all(np.isfinite(shares)) and np.all(shares >= 0) and shares.sum() > 0):
        raise ValueError("weights are negative, not finite, or add up to nothing. Expected a distribution.")
    poses, shares = poses[shares > 0], shares[shares > 0]
    return np.concatenate([np.average(poses[:, :3], 0, shares), mean_angle(poses[:, 3:], shares)])


def posture_error(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> float:
    """Mean distance of the mean posture from the truth over thirteen joints, mm.

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.

    Raises:
        ValueError: As :func:`mean_posture`, the body lacks a virtual marker, or the truth is not of fifteen.
    """
    true = np.asarray(truth, np.float64)
    if true.shape != (len(VIRTUAL_MARKERS), 3):
        raise ValueError(f"the truth has shape {true.shape}. Expected ({len(VIRTUAL_MARKERS)}, 3).")
    places = _places(tree, jnp.asarray(mean_posture(states, weights), float))
    distances = np.linalg.norm(virtual_markers(tree.marker_names, places) - true, axis=-1)
    return float(distances[_COMPARED].mean())


def posture_squares(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> Floats:
    """Mean squared distance of the mean posture from the truth over all fifteen markers, mm^2 (Table 3).

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.

    Returns:
        Shape (2,): as they are, and with the pelvises together.

    Raises:
        ValueError: As :func:`mean_posture`.
    """
    places = _places(tree, jnp.asarray(mean_posture(states, weights), float))
    apart = virtual_markers(tree.marker_names, places) - np.asarray(truth, np.float64)
    return np.array([np.square(each).sum(-1).mean() for each in (apart, apart - apart[:1])])


@jax.jit
def _places(tree: Any, state: Array) -> Array:
    return marker_positions(tree, state)
