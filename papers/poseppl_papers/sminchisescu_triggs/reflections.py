"""Motions through poses that a camera cannot distinguish from their mirror images: limbs that swing along the optical axis.

A limb in the image plane leaves it towards the camera or away from it, and looks the same (section 1.2 of the paper). Each
motion here takes limbs through such a pose, and on to one whose mirror image breaks a joint limit or runs through the trunk: a
tracker that keeps both can find out. The camera looks along the horizontal direction in which hands and feet move most.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from poseppl.arrays import Floats

Keys = Mapping[tuple[str, str], tuple[float, float, float, float]]
_ENDS = ("wrist_l", "wrist_r", "ankle_l", "ankle_r")
_BOTH = {"l": 1.0, "r": -1.0}
"""Sides, and the signs of turns about Y and Z."""


def _both(joint: str, axis: str, *angles: float) -> Keys:
    """The same angles of both sides, mirrored about Y and Z."""
    return {
        (f"{joint}_{side}", axis): tuple(angle * (1.0 if axis == "X" else sign) for angle in angles)  # type: ignore[misc]
        for side, sign in _BOTH.items()
    }


MOTIONS: Mapping[str, Keys] = {
    "reach": {("shoulder_r", "X"): (-0.7, 0.2, 1.4, 1.5), ("elbow_r", "X"): (0.4, 0.2, 0.1, 0.6)},
    "raise both arms": {**_both("shoulder", "X", -0.6, 0.6, 1.5, 2.2), **_both("elbow", "X", 0.5, 0.3, 0.2, 0.3)},
    "step": {("hip_r", "X"): (-0.4, 0.3, 1.3, 0.9), ("knee_r", "X"): (-0.2, -0.6, -1.4, -0.5)},
    "kick": {("hip_l", "X"): (-0.4, 0.2, 1.1, 0.2), ("knee_l", "X"): (-1.1, -1.2, -0.1, -0.3)},
    "bow": {("thorax", "X"): (0.3, -0.1, -1.2, -0.7), ("neck", "X"): (0.2, 0.0, -0.4, -0.2)},
    "push": {**_both("shoulder", "X", 0.3, 0.7, 1.4, 0.9), **_both("elbow", "X", 2.3, 1.8, 0.1, 1.2)},
    "throw": {
        ("shoulder_r", "Y"): (-1.3, -1.5, -1.4, -0.8),
        ("shoulder_r", "Z"): (-0.9, -0.2, 0.8, 1.2),
        ("elbow_r", "X"): (1.2, 0.7, 0.1, 0.4),
    },
    "fold the arms": {
        **_both("shoulder", "X", -0.3, 0.4, 0.8, 0.8),
        **_both("shoulder", "Z", 0.0, -0.3, -0.7, -0.5),
        **_both("elbow", "X", 0.3, 1.2, 1.7, 1.9),
    },
}
"""Angles (radians) at the start, after a third and two thirds of the time, and at the end, of coordinates that move."""


def swung(motion: str, body: Any, times: Floats, rng: np.random.Generator) -> Floats:
    """States (T, d) of a motion: angles of its own from run to run, and a body that is turned a little."""
    states = np.tile(np.asarray(body.rest, float), (len(times), 1))
    share = 3 * np.asarray(times) / max(float(times[-1]), 1e-9)
    step = np.clip(np.floor(share), 0, 2).astype(int)
    part = share - step
    part = part * part * (3 - 2 * part)
    for coordinate, keys in MOTIONS[motion].items():
        angles = np.array(keys) * rng.uniform(0.9, 1.05) + 0.05 * rng.normal(size=4)
        states[:, body.tree.coordinates.index(coordinate)] = angles[step] + part * (angles[step + 1] - angles[step])
    states[:, body.tree.coordinates.index(("pelvis", "Z"))] += rng.uniform(-0.2, 0.2)
    low, high = body.limits.T
    within: Floats = np.clip(states, low + 0.02, high - 0.02)
    return within


def axis_of_motion(names: Sequence[str], markers: Floats) -> Floats:
    """Horizontal unit vector (2,) in which hands and feet move most, of markers (T, K, 3), relative to the first one."""
    ends = [list(names).index(name) for name in _ENDS]
    places = markers[:, ends, :2] - markers[:, :1, :2]
    moved = (places - places.mean(0)).reshape(-1, 2)
    axis: Floats = np.linalg.eigh(moved.T @ moved)[1][:, -1]
    return axis * (1.0 if axis[1] >= 0 else -1.0)
