"""The scales of a body's velocities in a whole recording, with NumPy.

They are those of :mod:`poseppl.motion.tracking.velocity_learning`, of points with independent Gaussian errors and of poses that
are known about. Nothing is compiled.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from poseppl.arrays import Floats
from poseppl.gaussians.walk_chains import WalkChains, ar1_chains, expected_walk
from poseppl.motion.bodies.body import BodyInputs, Velocities
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.recorded_frames import MarkerKinematics, image_slopes
from poseppl.motion.tracking.walk_learning import NARROWEST, NUM_ROUNDS, WIDEST
from poseppl.program import Observation
from poseppl.runs.run import Constant


class SeenPoses(NamedTuple):
    """Points of K markers in C cameras, with independent errors.

    Attributes:
        kinematics: Kinematics of the K markers.
        cameras: C cameras.
        points: (T, C, K, 2), 0 where not seen.
        weights: Inverse standard deviations (T, C, K), 0 where not seen.
    """

    kinematics: MarkerKinematics
    cameras: Cameras
    points: Floats
    weights: Floats

    def expanded(self, poses: Floats) -> tuple[Floats, Floats]:
        """The log-likelihood of each frame around poses (T, d): its vector (T, d), and its information (T, d, d)."""
        places, moves = self.kinematics.places_and_moves(poses)
        seen, slopes = (np.swapaxes(each, 0, 1) for each in image_slopes(self.cameras, places))
        by_place = (slopes * self.weights[..., None, None]).transpose(0, 2, 4, 1, 3).reshape(*places.shape, -1)
        off = ((self.points - seen) * self.weights[..., None]).transpose(0, 2, 1, 3).reshape(*places.shape[:2], -1, 1)
        flat = moves.reshape(len(poses), -1, poses.shape[1])
        weighed = (by_place @ np.swapaxes(by_place, -1, -2)) @ moves
        information = np.swapaxes(flat, 1, 2) @ weighed.reshape(flat.shape)
        pull = (by_place @ off).reshape(len(poses), 1, -1) @ flat
        return (information @ poses[..., None])[..., 0] + pull[:, 0], information


def seen_poses(own: BodyInputs, observation: Observation) -> SeenPoses:
    """Lay out the site ``points`` of a body's programs, whose inputs are without wrapped constants."""
    points, mask = (np.asarray(part["points"]) for part in (observation.values, observation.mask))
    known = np.asarray(np.broadcast_to(mask, points.shape).all(-1))
    noise = np.broadcast_to(np.asarray(own.noise, np.float64), known.shape)
    weights = np.where(known, 1 / noise, 0.0)
    return SeenPoses(MarkerKinematics.of(own.tree), own.cameras, np.where(known[..., None], points, 0.0), weights)


def without_constants(inputs: Any) -> Any:
    """Inputs of programs with :class:`Constant` taken off."""
    return jax.tree.map(
        lambda leaf: leaf.value if isinstance(leaf, Constant) else leaf, inputs, is_leaf=lambda leaf: isinstance(leaf, Constant)
    )


def velocity_chains(own: BodyInputs) -> WalkChains:
    """How poses and their velocities walk, by inputs of ``poseppl_models.bodies.detected_points`` without constants."""
    steps, start, spread = (np.asarray(each, np.float64) for each in (own.step_scale, own.start, own.start_scale))
    paces: Any = own.velocities
    scale, kept, along = (np.asarray(each, np.float64) for each in paces)
    left, mean = np.ones_like(steps), np.zeros_like(steps)
    if own.posture is not None:
        left = np.asarray(own.posture.kept, np.float64)
        mean = (1 - left) * np.asarray(own.posture.mean, np.float64)
    whole, way = 1 / steps, left * along[:, None] / steps
    whole[0], way[0], mean[0] = 1 / spread, 0.0, start
    before = left / steps
    before[0] = 0.0
    pace = ar1_chains(kept, scale, len(scale))
    return WalkChains(whole, before, -way, way, whole * mean).beside(pace)


def learned_paces(
    own: BodyInputs,
    seen: SeenPoses,
    poses: Floats,
    groups: Sequence[int],
    speeds: Floats,
    units: tuple[Floats, Floats, Floats],
) -> Floats:
    """Scales (d,) of velocities, in units of speeds (d,), by expectation maximisation.

    Args:
        own: Inputs of the body's programs, without wrapped constants.
        seen: The points.
        poses: To start from (T, d).
        groups: Number of the group of each coordinate (d,), whose scales are one.
        speeds: mm or radians, in a second.
        units: As of :func:`poseppl.motion.tracking.walk.velocity_steps`.
    """
    (kept, step, way), group, width = units, np.asarray(groups), len(speeds)
    members, scales = np.bincount(group), np.ones(width)
    for _ in range(NUM_ROUNDS):
        there = speeds * scales
        paces: Any = {"step_scale": way[:, None] * there, "velocities": Velocities(there, kept, step)}
        walk = own._replace(**paces)
        vector, information = seen.expanded(poses)
        try:
            found = expected_walk(velocity_chains(walk), information, vector)
        except np.linalg.LinAlgError:
            break
        squares = found.squares[1:, :width].sum(0) + found.squares[:, width:].sum(0)
        variance = np.bincount(group, scales**2 * squares) / members / (2 * len(poses) - 1)
        new = np.sqrt(np.clip(variance, NARROWEST**2, WIDEST**2))[group]
        if not (np.isfinite(new).all() and np.isfinite(found.means).all()):
            break
        scales, poses = new, found.means[:, :width]
    return scales
