"""Markers and angles of which the detected points of a body show nothing: their posterior is their prior.

Let J be the derivatives, at a pose without symmetry, of the positions of all detected markers by all joints but the root. The
null space of J moves no detected marker. A marker or an angle that the null space moves is unseen. Examples are the crown if no
point of the head is detected, and the rotation of a thigh of which only the knee is detected. Points between detected ones,
such as a chest between shoulders and hips, are not unseen. Nor is the rotation of a thigh above a straight knee, which a bent
knee would show: its interval is wide. The root is left out, because a spine is a line: its rotation, with its parts turned
back, never moves a marker.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Booleans, Floats
from poseppl.motion.bodies.body import Body
from poseppl.motion.bodies.opensim import SEGMENT_AXES, own_coordinates, rotations_of
from poseppl.motion.geometry import KinematicTree

_NONE = 1e-6
"""Rounding error, relative to the largest singular value and to a derivative of order 1."""


class Unseen(NamedTuple):
    """Names of unseen markers, and of unseen coordinates of :func:`poseppl.motion.bodies.opensim.opensim_coordinates`."""

    markers: tuple[str, ...] = ()
    coordinates: tuple[str, ...] = ()


def unseen_parts(body: Body, seen: Booleans) -> Unseen:
    """Find what is unseen.

    Args:
        body: The body.
        seen: Whether a camera saw each marker (K,) in some frame.
    """
    tree = body.tree
    free = [index for index in body.free_coordinates if tree.coordinates[index][0] != tree.joint_names[0]]
    moved = _Moved(tree, np.random.default_rng(0).uniform(-0.9, 0.9, tree.dimension))
    places = moved.places[:, :, free]
    scale = np.maximum(np.abs(places).max((0, 1)), _NONE)  # mm a mm, and mm a radian
    _, values, rows = np.linalg.svd(places[seen].reshape(-1, len(free)) / scale)
    rank = int((values > _NONE * values.max(initial=0.0)).sum())
    hidden = np.zeros((tree.dimension, len(free) - rank))
    hidden[free] = (rows[rank:] / scale).T
    markers = [name for name, each in zip(tree.marker_names, moved.places @ hidden, strict=True) if _any(each)]
    coordinates = [name for name, each in _coordinates(body, moved) if _any(each @ hidden)]
    return Unseen(tuple(name for name in markers if not seen[tree.marker_names.index(name)]), tuple(coordinates))


def _coordinates(body: Body, moved: _Moved) -> Iterator[tuple[str, Floats]]:
    """The coordinates of motion files, except positions, and their derivatives (d,)."""
    joints = body.segments
    for each in rotations_of(body):
        yield from zip(each.names, moved.rates_between(joints.get(each.above), joints[each.below]), strict=False)
    for index in own_coordinates(body):
        yield body.tree.coordinate_names[index], np.eye(body.tree.dimension)[index]


def _any(values: Floats) -> bool:
    return bool((np.abs(values) > _NONE).any())


class _Moved:
    """How a body moves with its coordinates at a pose.

    Attributes:
        places: Derivatives (K, 3, d) of the markers' places, mm by mm and radians.
    """

    def __init__(self, tree: KinematicTree, pose: Floats) -> None:
        count, self._tree = len(tree.parents), tree
        self.turns, axes = np.zeros((count, 3, 3)), np.zeros((count, 3, tree.dimension))
        offsets = np.asarray(tree.offsets, np.float64)
        shifts = np.zeros((count, 3, tree.dimension))
        for link, parent in enumerate(tree.parents):
            turn = np.eye(3)
            if parent >= 0:
                turn, axes[link] = self.turns[parent], axes[parent]
                arm = turn @ offsets[link]
                shifts[link] = shifts[parent] + np.cross(axes[parent], arm, axisa=0, axisc=0)
            else:
                shifts[link][:, :3] = np.eye(3)
            for index, axis in zip(tree.angle_index[link], "ZYX", strict=True):
                if index >= 0:
                    axes[link][:, index] += turn @ np.eye(3)["XYZ".index(axis)]
                    turn = turn @ Rotation.from_euler(axis, pose[index]).as_matrix()
            self.turns[link] = turn
        self.axes = axes
        arms = np.einsum("kij,kj->ki", self.turns[list(tree.marker_link)], np.asarray(tree.marker_offsets, np.float64))
        self.places = np.stack(
            [
                shifts[link] + np.cross(axes[link], arm, axisa=0, axisc=0)
                for link, arm in zip(tree.marker_link, arms, strict=True)
            ]
        )

    def rates_between(self, above: str | None, below: str) -> Floats:
        """Derivatives (3, d) of the angles about Z, X and Y of OpenSim between two joints' segments; above None, the ground."""
        lower = self._tree.last_links[below]
        upper = None if above is None else self._tree.last_links[above]
        frame = SEGMENT_AXES if upper is None else self.turns[upper] @ SEGMENT_AXES
        turned = frame.T @ self.turns[lower] @ SEGMENT_AXES
        rate = frame.T @ (self.axes[lower] - (0.0 if upper is None else self.axes[upper]))
        first, second, _ = Rotation.from_matrix(turned).as_euler("ZXY")
        about_z = Rotation.from_euler("Z", first).as_matrix()
        about_x = about_z @ Rotation.from_euler("X", second).as_matrix()
        return np.asarray(np.linalg.solve(np.stack([[0.0, 0.0, 1.0], about_z[:, 0], about_x[:, 1]], 1), rate))
