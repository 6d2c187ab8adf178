"""The paper's error (section 5.1): the distance of the mean posture from the truth, at thirteen of the fifteen joints.

The mean posture is the weighted mean of positions and joint angles, not of places; its virtual markers stand against the true
ones (Sigal and Black 2006, Eqs. 3 to 6). The hips, the upper ends of the legs, are left out: the paper found no points on its
body that matched them well.
"""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.motion.geometry import KinematicTree, marker_positions
from poseppl.motion.learned.angles import mean_angle
from poseppl.motion.tracking.marker_errors import VIRTUAL_MARKERS, virtual_markers

LEFT_OUT = ("hip_l", "hip_r")
_COMPARED = [number for number, name in enumerate(VIRTUAL_MARKERS) if name not in LEFT_OUT]


def mean_posture(states: ArrayLike, weights: ArrayLike) -> Floats:
    """The weighted mean of poses: of positions, and of angles as directions, so that whole turns do not matter.

    Args:
        states: (N, d), three positions (mm) and then angles (radians).
        weights: (N,), which need not add up to 1; the state of a particle of no weight does not matter.

    Returns:
        The mean (d,).
    """
    poses, shares = np.asarray(states, np.float64), np.asarray(weights, np.float64)
    poses, shares = poses[shares > 0], shares[shares > 0]
    return np.concatenate([np.average(poses[:, :3], 0, shares), mean_angle(poses[:, 3:], shares)])


def posture_error(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> float:
    """Mean distance of the mean posture from the truth over thirteen joints, mm.

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.
    """
    return float(np.linalg.norm(_offsets(tree, states, weights, truth), axis=-1)[_COMPARED].mean())


def posture_squares(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> Floats:
    """Mean squared distance of the mean posture from the truth over all fifteen markers, mm^2 (Table 3).

    Args:
        tree: The body.
        states: As :func:`mean_posture` takes them.
        weights: Likewise.
        truth: The fifteen virtual markers (15, 3), mm.

    Returns:
        Shape (2,): as they are, and with the pelvises together.
    """
    apart = _offsets(tree, states, weights, truth)
    return np.array([np.square(each).sum(-1).mean() for each in (apart, apart - apart[:1])])


def _offsets(tree: KinematicTree, states: ArrayLike, weights: ArrayLike, truth: ArrayLike) -> Floats:
    """Offsets (15, 3), mm, of the mean posture's virtual markers from the truth."""
    places = _places(tree, jnp.asarray(mean_posture(states, weights), float))
    return np.asarray(virtual_markers(tree.marker_names, places) - np.asarray(truth, np.float64))


@jit
def _places(tree: Any, state: Array) -> Array:
    return marker_positions(tree, state)
