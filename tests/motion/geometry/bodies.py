"""Bodies with every kind of joint, and their kinematics as plain NumPy loops."""

from __future__ import annotations

import numpy as np

from poseppl.motion.geometry import Joint, Marker, kinematic_tree

JOINTS = (
    Joint("root", None, (0, 0, 0), "ZYX"),
    Joint("side", "root", (120.0, 30.0, -60.0), "XYZ"),
    Joint("wheel", "side", (0, 0, -400.0), "Y"),
    Joint("top", "root", (0, 0, 500.0), "ZXY"),
    Joint("fixed", "top", (10.0, 0, 90.0), ""),
    Joint("tip", "fixed", (0, 50.0, 0), "XX"),
)
MARKERS = (
    Marker("origin", "root"),
    Marker("far", "tip", (10.0, -20.0, 130.0)),
    Marker("rim", "wheel", (0, 80.0, -300.0)),
    Marker("knob", "fixed", (0, 0, 40.0)),
    Marker("shoulder", "side"),
)


def mixed_tree():
    return kinematic_tree(JOINTS, MARKERS)


def states(tree, count, seed=0):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (count, tree.dimension - 3))
    return np.concatenate([rng.normal(0, 800, (count, 3)), angles], axis=1)


def rotate(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    return {
        "X": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "Y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "Z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def plain_kinematics(joints, markers, state):
    """Markers (K, 3) in mm by products of matrices, joint by joint."""
    frames, used = {}, 3
    for joint in joints:
        turn, origin = np.eye(3), np.asarray(state[:3], float)
        if joint.parent is not None:
            turn, above = frames[joint.parent]
            origin = above + turn @ np.array(joint.offset)
        for axis in joint.axes:
            turn = turn @ rotate(axis, state[used])
            used += 1
        frames[joint.name] = turn, origin
    assert used == len(state)
    return np.array([frames[m.joint][1] + frames[m.joint][0] @ np.array(m.offset) for m in markers])
