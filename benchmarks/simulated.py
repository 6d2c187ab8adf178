"""The problem that filters are measured on: the 28-DOF body as its own model simulates it, seen by one camera at 5 m."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from poseppl_models.bodies.choo_fleet import full_body

from poseppl.motion.bodies.body import Body, BodyInputs
from poseppl.motion.geometry import paper_camera
from poseppl.program import CompiledModel, Observation
from poseppl.runs.simulation import simulate

SIGMA_POSITION, SIGMA_ANGLE = 7.5, 0.075
"""Standard deviations of a step, mm and radians."""
START_POSITION, START_ANGLE = 15.0, 0.15
NOISE = 0.003


class Problem(NamedTuple):
    """A body, its compiled model and the inputs of every frame."""

    body: Body
    model: CompiledModel
    inputs: BodyInputs


def build_problem(scale: float = 1.0) -> Problem:
    """The full body: transition 7.5 mm and 0.075 rad, noise 0.003, first state 15 mm and 0.15 rad off; all times scale."""
    body = full_body()
    camera = paper_camera((0.0, -5000.0, 1000.0))
    noise = jnp.full((1, len(body.tree.marker_names)), scale * NOISE)
    spreads = ((START_POSITION, START_ANGLE), (SIGMA_POSITION, SIGMA_ANGLE))
    scales = (jnp.where(jnp.arange(body.tree.dimension) < 3, scale * position, scale * angle) for position, angle in spreads)
    inputs = BodyInputs(camera, noise, jnp.asarray(body.rest, jnp.float32), *scales, body.tree)
    model = body.program.compile(inputs=inputs)
    return Problem(body, model, inputs)


class Sequence(NamedTuple):
    """True states (T, d) and the points that the camera saw."""

    states: jax.Array
    observations: Observation


def draw_sequence(problem: Problem, seed: int, num_frames: int) -> Sequence:
    """Simulate a sequence from the model itself."""
    inputs = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_frames, *leaf.shape)), problem.inputs)
    drawn = simulate(problem.model, jax.random.key(seed), num_frames, inputs)
    return Sequence(drawn.states, problem.model.observe(drawn.values, frames=num_frames))
