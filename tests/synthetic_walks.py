"""Walks that need no recording: a cycle of two harmonics in the plane of two angles, beside a body's other coordinates."""

from __future__ import annotations

import numpy as np

from poseppl.motion.learned import PosedRecording

COORDINATES = ("hip.tx", "hip.ty", "hip.tz", "hip.Z", "neck.X", "a.X", "b.X", "c.X")
LOADINGS = np.array([[0.5, 0.1], [0.0, 0.4], [0.3, -0.3]])


def walk(person, offset, frames=200, seed=0, rate=60.0):
    """A recording whose learned angles are an offset, a loop in two dimensions and a little noise."""
    rng = np.random.default_rng(seed)
    phase = 0.15 * np.arange(frames) + rng.uniform(0, 6)
    loop = np.stack([np.cos(phase), np.sin(phase)], 1)
    states = np.zeros((frames, len(COORDINATES)))
    states[:, 0] = 20.0 * np.arange(frames)
    states[:, 4] = 0.1 * rng.standard_normal(frames)
    states[:, 5:] = offset + loop @ LOADINGS.T + 0.02 * rng.standard_normal((frames, 3))
    return PosedRecording(states, COORDINATES, "hip", rate, person, f"{person}.bvh", 1.0)


def walks():
    """Two people, the second of whom has turned an arm once around."""
    around = 2 * np.pi * np.array([0, 1, 0])
    return [walk("tall", np.array([0.2, 0.0, 3.1]), seed=1), walk("small", np.array([-0.1, 0.3, 3.0]) + around, seed=2)]
