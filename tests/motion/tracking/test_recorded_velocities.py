"""Velocities that NumPy learns in a recording: those that the programs lead to, from the same poses."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_marginal_smoothing import FRAMES, RATE, seen_walk

from poseppl.compilation import double_precision
from poseppl.gaussians.walk_chains import expected_walk
from poseppl.motion.bodies.body import Velocities
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking.problem import body_inputs, make_problem
from poseppl.motion.tracking.recorded_velocities import seen_poses, velocity_chains, without_constants
from poseppl.motion.tracking.triangulated_start import triangulated_places, triangulated_poses
from poseppl.motion.tracking.velocity_learning import velocity_walk
from poseppl.motion.tracking.walk import velocity_steps
from poseppl.motion.tracking.walk_learning import Expansion, expand, expected_innovations
from poseppl.runs.frame_sequence import frame_sequence


@pytest.mark.full
def test_expected_innovations_are_those_of_the_programs() -> None:
    """The likelihood around the same poses, and the expected squares of the walk's innovations in it, in float64."""
    scene = seen_walk(walking_subject(frames=f"0:{FRAMES}", rate=RATE))
    problem, seconds = make_problem(scene), np.full(FRAMES, 1 / RATE)
    poses = triangulated_poses(scene.body, triangulated_places(problem, scene.data.points), seconds)
    own = without_constants(body_inputs(problem.inputs))
    width, scale = poses.shape[1], np.where(np.arange(poses.shape[1]) < 3, 300.0, 0.8)
    kept, step, way = units = velocity_steps(seconds)
    walk = own._replace(step_scale=way[:, None] * scale, velocities=Velocities(scale, kept, step))
    vector, information = seen_poses(own, problem.observations).expanded(poses)
    found = expected_walk(velocity_chains(walk), information, vector)
    with double_precision():
        sequence = frame_sequence(problem.observations, problem.inputs, None)
        data: Any = jax.tree.map(
            lambda leaf: jnp.asarray(np.asarray(leaf, np.float64 if np.asarray(leaf).dtype.kind == "f" else None)),
            (sequence.observations, sequence.stacked_inputs()),
        )
        expansion = jax.jit(lambda xs: expand(problem.model, xs, *data))(jnp.asarray(poses))
        free = scene.body.free_coordinates
        turning = velocity_walk(problem.model, jnp.asarray(scale), tuple(map(jnp.asarray, units)), free, data[1])
        padded = (jnp.pad(each, ((0, 0), *((0, width) for _ in each.shape[1:]))) for each in expansion)
        means, covariances, products = map(np.asarray, expected_innovations(turning, Expansion(*padded)))
    np.testing.assert_allclose(vector, expansion.vector, rtol=1e-5, atol=1e-4 * np.abs(vector).max())
    np.testing.assert_allclose(information, expansion.information, atol=1e-6 * np.abs(information).max())
    np.testing.assert_allclose(found.means, means, atol=1e-3)
    turn = np.eye(2 * width) - np.diag(np.full(width, step[0]), k=width)
    squares = np.einsum("ij,tjk,ik->ti", turn, products, turn)
    expected = np.concatenate(
        [squares[:, :width] / (way[0] * scale) ** 2, squares[:, width:] / (1 - kept[0] ** 2) / scale**2], 1
    )
    np.testing.assert_allclose(found.squares[1:], expected, rtol=1e-3)
    first = (means[0, width:] ** 2 + np.diagonal(covariances[0])[width:]) / scale**2
    np.testing.assert_allclose(found.squares[0, width:], first, rtol=1e-4)
