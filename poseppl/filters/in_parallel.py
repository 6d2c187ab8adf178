"""Filters that are formulas, run over all frames at once: which schedule a run has, and what Kalman's elements are.

A sequence of T frames takes T steps one after the other, or O(log T) steps of an associative scan, each of more operations.
On a GPU, where a step costs its launch, the scan pays; on a CPU it does not.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import Gaussian, Linear, RootGaussian, semidefinite_root
from poseppl.gaussians.linear_transitions import observation_structure, transition_structure
from poseppl.gaussians.linearisation import Method, linearise
from poseppl.gaussians.parallel import LinearFrames, filter_in_parallel
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation

Schedule = Literal["auto", "sequential", "parallel"]
"""How :func:`~poseppl.filters.scan.scan_filter` runs frames; "auto" is parallel where a GPU or TPU computes."""


def wants_parallel(schedule: Schedule, suits: bool) -> bool:
    """Whether frames are run in parallel, where this suits the model."""
    return schedule == "parallel" or (schedule == "auto" and suits and jax.default_backend() != "cpu")


def is_linear(model: CompiledModel, inputs: Any) -> bool:
    """Whether transition and observation are linear and Gaussian, with inputs of T frames."""
    return transition_structure(model, inputs).linear and observation_structure(model, inputs).linear


class LinearSequence(NamedTuple):
    """The programs of T frames, linearised: their conditionals, the data and their filtered Gaussians.

    Attributes:
        initial: Gaussian of the first frame's state, before its data, by a root of its covariance.
        transitions: Transitions into each frame; the first one is unused.
        observations: Observation of each frame; missing entries do not depend on the state.
        data: (T, k).
        filtered: Means (T, d) and covariances (T, d, d).
    """

    initial: RootGaussian
    transitions: LinearFrames
    observations: LinearFrames
    data: Array
    filtered: Gaussian


def linear_sequence(
    model: CompiledModel, observations: Observation, inputs: Any, method: Method, about: RootGaussian | None = None
) -> LinearSequence:
    """Filter in parallel; without Gaussians (T, ...) to linearise around, all frames are linearised around the initial one."""
    mean, covariance = model.initial_moments(tree_index(inputs, 0))
    initial = RootGaussian(mean, semidefinite_root(covariance))
    num_frames = len(jax.tree.leaves(observations)[0])
    around = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (num_frames, *leaf.shape)), initial) if about is None else about
    before, later = tree_index(around, slice(-1)), tree_index(inputs, slice(1, None))

    def transition(x: RootGaussian, inputs: Any) -> LinearFrames:
        return _line(linearise(lambda state: model.transition_moments(state, inputs), x, method), x)

    def observed(x: RootGaussian, observation: Observation, inputs: Any) -> tuple[LinearFrames, Array]:
        data, seen = model.flat_observation(observation)
        linear = linearise(
            lambda state: model.observation_moments(state, inputs),
            x,
            method,
            lambda state: model.observation_jacobian(state, inputs),
        )
        line = _line(linear, x)
        noise = jnp.where(seen[:, None] & seen, line.noise, jnp.eye(len(data), dtype=line.noise.dtype))
        jacobian = jnp.where(seen[:, None], line.jacobian, 0.0)
        return LinearFrames(jacobian, line.offset, noise), jnp.where(seen, data, line.offset)

    moved = jax.vmap(transition)(before, later)
    nothing = jax.tree.map(lambda leaf: jnp.zeros_like(leaf[:1]), moved)
    transitions = jax.tree.map(lambda first, rest: jnp.concatenate([first, rest]), nothing, moved)
    lines, data = jax.vmap(observed)(around, observations, inputs)
    filtered = filter_in_parallel(initial.mean, covariance, transitions, lines, data)
    return LinearSequence(initial, transitions, lines, data, filtered)


def _line(linear: Linear, about: RootGaussian) -> LinearFrames:
    """A conditional that was linearised around a Gaussian, by its offset at 0."""
    return LinearFrames(linear.jacobian, linear.mean - linear.jacobian @ about.mean, linear.noise)
