"""Positions of a person's markers on the body, learned from the recording.

A body of a few rigid parts has joints that are not quite a person's. A filter takes what lies between them for motion, and its
intervals are too narrow by it (`python -m studies.marker_places`). Here each marker k may sit beside its own place o_k,

    o_k + e_k,  e_k ~ N(0, SPREAD^2) along each axis of the part,

and e maximises that prior times the likelihood at a smoother's trajectory, which is found again in each round: expectation
maximisation with the expected log-likelihood taken at the smoothed mean. Two cameras or more have to see the person: one does
not tell how deep a marker lies. The places are then taken for certain, so that intervals stay a little too narrow: of
simulated people whose places are drawn from this prior they hold 88 % (tests/motion/tracking/test_marker_learning.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.errors import Argument, InputError
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import Problem, body_inputs, make_problem, with_tree
from poseppl.motion.tracking.scene import Scene, SceneData
from poseppl.motion.tracking.walk_learning import smoothed_walk
from poseppl.program import CompiledModel, Observation
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.smoothers import smoothed_moments

SPREAD = 4.0
"""Standard deviation of a marker's place on its part along each axis, mm; ours, from recorded skeletons."""
NUM_ROUNDS, NUM_STEPS = 5, 20
"""Rounds of expectation maximisation, and steps of the ascent in each."""


def learn_markers(scene: Scene[SceneData], params: Mapping[str, float]) -> Scene[SceneData]:
    """Give a scene's body markers where its data are most likely to have them.

    Args:
        scene: The scene.
        params: Params of the body's programs, whose random walk is taken.

    Returns:
        The scene, whose body has other ``marker_offsets``.

    Raises:
        InputError: The data are no points or of one camera alone, or the body's observation has no Gaussian moments.
    """
    if not isinstance(scene.data, PointData):
        raise InputError("a silhouette has no markers", field=Argument("markers"), expected="fixed")
    tree = scene.body.tree
    problem = make_problem(_with_tree(scene, tree.with_markers_at(tree.marker_offsets)), params)
    if problem.num_cameras < 2:
        expected = "fixed, or two cameras, which determine the depth of a marker"
        raise InputError("one camera cannot locate markers on the body", field=Argument("markers"), expected=expected)
    try:
        places = _learn(problem)
    except ValueError as error:
        raise InputError(
            f"this body's markers cannot be learned: {error}", field=Argument("markers"), expected="fixed"
        ) from error
    return _with_tree(scene, tree.with_markers_at(places))


def _with_tree(scene: Scene[SceneData], tree: KinematicTree) -> Scene[SceneData]:
    return scene._replace(body=scene.body._replace(tree=tree))


def _learn(problem: Problem) -> Floats:
    """Offsets (K, 3) of the markers in their parts, mm."""
    model, free = problem.model, problem.body.free_coordinates
    sequence = frame_sequence(problem.observations, problem.inputs, None)
    observations, inputs = jax.tree.map(jnp.asarray, sequence.observations), sequence.stacked_inputs()
    known = places = np.asarray(problem.body.tree.marker_offsets, np.float64)
    trajectory = _first(model, observations, inputs)
    for _ in range(NUM_ROUNDS):
        trajectory = _smoothed(model, free, jnp.asarray(places, float), trajectory, observations, inputs)
        if not np.isfinite(trajectory).all():
            raise ValueError("the smoothed poses are not finite")
        loss = partial(_loss, model, trajectory, jnp.asarray(known, float), observations, inputs)
        places = _minimum(loss, places)
    return places


def _minimum(loss: Any, places: Floats) -> Floats:
    """Minimise a loss with its gradient, from given positions (K, 3)."""

    def flat(values: Floats) -> tuple[float, Floats]:
        value, gradient = loss(jnp.asarray(values.reshape(places.shape), float))
        return float(value), np.asarray(gradient, np.float64).ravel()

    found: Floats = scipy.optimize.minimize(flat, places.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": NUM_STEPS}).x
    return found.reshape(places.shape)


def _moved(inputs: Any, places: Array) -> Any:
    """Inputs of T frames with the markers at other places (K, 3) of their parts."""
    tree = body_inputs(inputs).tree
    return with_tree(inputs, tree.with_offsets(tree.offsets, jnp.broadcast_to(places, tree.marker_offsets.shape)))


@partial(jit, static_argnums=0)
def _first(model: CompiledModel, observations: Observation, inputs: Any) -> Array:
    return smoothed_moments(model, observations, inputs).mean


@partial(jit, static_argnums=(0, 1))
def _smoothed(
    model: CompiledModel, free: tuple[int, ...], places: Array, trajectory: Array, observations: Observation, inputs: Any
) -> Array:
    steps = body_inputs(inputs).step_scale[:, jnp.asarray(free)]
    return smoothed_walk(model, free, steps, trajectory, observations, _moved(inputs, places))[0]


@partial(jit, static_argnums=0)
def _loss(
    model: CompiledModel, trajectory: Array, known: Array, observations: Observation, inputs: Any, places: Array
) -> tuple[Array, Array]:
    """Minus the log-likelihood at a trajectory (T, d) and the log-prior of the places, with the gradient in these."""

    def loss(places: Array) -> Array:
        seen = jax.vmap(model.log_observation)(trajectory, observations, _moved(inputs, places))
        return jnp.sum(jnp.square((places - known) / SPREAD)) / 2 - jnp.sum(seen)

    return jax.value_and_grad(loss)(places)
