"""The scales of a body's random walk, learned from the recording: expectation maximisation on a smoother.

There is one scale s_g for each joint that turns, and one for each of the root's translations. Under given scales a smoother
computes the expected squared steps w^2 of each coordinate. The most likely scales given these are their means over frames and
coordinates, in units of the body's own steps q:

    s_g^2 = mean over t >= 1 and i in g of E[w_ti^2 | all data, s] / q_ti^2.

Angles of a mean-reverting walk keep their steps, which make it stationary.

A runner moves 8 of the published steps a frame forwards and less than one sideways. With one scale for all translations a
single camera loses the runner's distance (studies/fast_motion.py).

Each round makes the data more likely in a linear Gaussian model (Shumway and Stoffer 1982,
doi:10.1111/j.1467-9892.1982.tb00349.x). Here the likelihood is expanded around the last round's trajectory, by its gradient and
its Gauss-Newton curvature, all frames at once, and around an extended Kalman smoother's in the first. This is one mode; the
filter that then tracks with the learned scales may find others. Later frames influence the steps of a frame.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.errors import Argument, InputError
from poseppl.gaussians.block_tridiagonal import block_cholesky, marginal_covariances, solve
from poseppl.gaussians.gaussian import Gaussian, precision_of
from poseppl.gaussians.linear_transitions import LinearTransitions, quadratic_prior
from poseppl.motion.bodies.body import Body
from poseppl.motion.tracking.problem import Problem, body_inputs, with_steps
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.runs.frame_sequence import frame_inputs, frame_sequence
from poseppl.smoothers import smoothed_moments
from poseppl.stored_programs import stored_jit

NUM_ROUNDS = 20
"""Rounds of expectation maximisation."""
NARROWEST, WIDEST = 1 / 30, 30.0
"""Bounds of the scales, in units of the body's own."""


class Expansion(NamedTuple):
    """log p(z_t | x) = y_t x - x I_t x / 2 + const.: y (T, d) and I (T, d, d)."""

    vector: Array
    information: Array


def learn_walk(problem: Problem) -> Problem:
    """Give a problem the random walk that its data are most likely under.

    Args:
        problem: The problem, with the body's own steps.

    Returns:
        The problem with the learned steps; as it was, if it is of a single frame.

    Raises:
        InputError: The body's transition is not the walk of its inputs' ``step_scale`` and ``posture``, or its observation has
            no Gaussian moments.
    """
    own = body_inputs(problem.inputs).step_scale
    if len(own) < 2:
        return problem
    return problem._replace(inputs=with_steps(problem.inputs, own * learned_scales(problem, _learn)))


def learned_scales(problem: Problem, learn: Callable[..., Array]) -> Array:
    """Scales (d,) of a problem's walk that ``learn(model, groups, free, observations, inputs)`` finds.

    Raises:
        InputError: As of :func:`learn_walk`.
    """
    check_walk(problem)
    sequence = frame_sequence(problem.observations, problem.inputs, None)
    data = jax.tree.map(jnp.asarray, sequence.observations), sequence.stacked_inputs()
    try:
        return learn(problem.model, groups_of(problem.body), problem.body.free_coordinates, *data)
    except ValueError as error:
        raise _unlearnable(error) from error


def check_walk(problem: Problem) -> None:
    """Refuse transitions of a problem, of two frames or more, that are not N(mean + kept (x - mean), step_scale^2).

    Raises:
        InputError: They are not, or have no Gaussian moments.
    """
    model, free = problem.model, problem.body.free_coordinates
    x, second = np.ones(model.dimension, np.float32), frame_inputs(problem.inputs, 1)
    try:
        mean, covariance = _transition_moments(model, x, second)
    except ValueError as error:
        raise _unlearnable(error) from error
    own = jax.tree.map(np.asarray, body_inputs(second))
    kept, offset = (np.asarray(each) for each in reversion(own, free))
    still = np.allclose(mean, kept * x + offset, atol=1e-5)
    if not still or not np.allclose(covariance, np.diag(own.step_scale[list(free)] ** 2), rtol=1e-3, atol=0.0):
        raise _unlearnable("its transition is not the random walk of its inputs' step_scale and posture")


@partial(stored_jit, num_static=1)
def _transition_moments(model: CompiledModel, x: Array, inputs: Any) -> tuple[Array, Array]:
    mean, covariance = model.transition_moments(x, inputs)
    return mean, covariance


def _unlearnable(why: object) -> InputError:
    return InputError(f"the walk of this body cannot be learned: {why}", field=Argument("walk"), expected="fixed")


def reversion(inputs: Any, free: tuple[int, ...]) -> tuple[Array, Array]:
    """Share of the previous free coordinates (..., d) that remains, and the offset that is added."""
    chosen = jnp.asarray(free)
    if inputs.posture is None:
        still = jnp.ones_like(inputs.step_scale[..., chosen])
        return still, jnp.zeros_like(still)
    left = inputs.posture.kept[..., chosen]
    return left, (1 - left) * inputs.posture.mean[..., chosen]


def groups_of(body: Body) -> tuple[int, ...]:
    """Number of the group of each free coordinate: a joint's axes share one, each of the root's translations has its own."""
    coordinates = [body.tree.coordinates[index] for index in body.free_coordinates]
    names = [(joint, axis if axis in ("tx", "ty", "tz") else "") for joint, axis in coordinates]
    return tuple(list(dict.fromkeys(names)).index(name) for name in names)


@partial(stored_jit, num_static=3)
def _learn(
    model: CompiledModel,
    groups: tuple[int, ...],
    free: tuple[int, ...],
    observations: Observation,
    inputs: Any,
) -> Array:
    """Scales (d,) of all coordinates in units of the inputs' own steps; 1 where they are clamped."""
    whole = body_inputs(inputs).step_scale
    own, group, number = whole[:, jnp.asarray(free)], jnp.asarray(groups), max(groups) + 1
    blank = jnp.zeros(number, own.dtype)
    members = blank.at[group].add(1.0)
    reverts = blank.at[group].add(reversion(body_inputs(inputs), free)[0][-1] < 1) > 0

    def update(_: int, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        scales, trajectory = carry
        smoothed, squares = smoothed_walk(model, free, own * scales[group], trajectory, observations, inputs)
        means = blank.at[group].add(jnp.mean(squares / jnp.square(own[1:]), 0)) / members
        new = jnp.where(reverts, 1.0, jnp.sqrt(jnp.clip(means, NARROWEST**2, WIDEST**2)))
        fine = jnp.all(jnp.isfinite(new)) & jnp.all(jnp.isfinite(smoothed))
        return jnp.where(fine, new, scales), jnp.where(fine, smoothed, trajectory)

    start = smoothed_moments(model, observations, inputs).mean
    scales, _ = jax.lax.fori_loop(0, NUM_ROUNDS, update, (blank + 1, start))
    return jnp.ones_like(whole[0]).at[jnp.asarray(free)].set(scales[group])


def smoothed_walk(
    model: CompiledModel, free: tuple[int, ...], steps: Array, trajectory: Array, observations: Observation, inputs: Any
) -> tuple[Array, Array]:
    """Smoothed means (T, d) and expected squared steps (T - 1, d) under steps (T, d), the data expanded around a trajectory."""
    first = Gaussian(*model.initial_moments(tree_index(inputs, 0)))
    return expected_steps(first, expand(model, trajectory, observations, inputs), steps, *reversion(body_inputs(inputs), free))


def expand(model: CompiledModel, trajectory: Array, observations: Observation, inputs: Any) -> Expansion:
    """The likelihood of each frame around a trajectory (T, d)."""

    def one(x: Array, observation: Observation, inputs: Any) -> Expansion:
        information = model.observation_information(x, observation, inputs)
        return Expansion(information @ x + jax.grad(model.log_observation)(x, observation, inputs), information)

    expansion: Expansion = jax.vmap(one)(trajectory, observations, inputs)
    return expansion


def expected_steps(first: Gaussian, expansion: Expansion, steps: Array, kept: Array, offset: Array) -> tuple[Array, Array]:
    """Smoothed means (T, d) of a walk, and expected squares (T - 1, d) of x_t - kept_t x_(t-1) - offset_t, given all data.

    Args:
        first: Mean (d,) and covariance (d, d) of the first state.
        expansion: Log-likelihood of each frame.
        steps: Standard deviations (T, d) of the step to each frame; the first is not read, nor that of the others.
        kept: Share of a coordinate that remains (T, d), 1 in a random walk.
        offset: Offset that is added to it (T, d), 0 in a random walk.
    """
    walk = LinearTransitions(
        jnp.concatenate([first.mean[None], offset[1:]]),
        jnp.concatenate([jnp.zeros_like(first.covariance)[None], jax.vmap(jnp.diag)(kept[1:])]),
        jnp.concatenate([precision_of(first.covariance)[None], jax.vmap(jnp.diag)(steps[1:] ** -2)]),
    )
    means, _, squares = expected_innovations(walk, expansion)
    return means, jnp.diagonal(squares, axis1=1, axis2=2)


def expected_innovations(walk: LinearTransitions, expansion: Expansion, ridge: float = 0.0) -> tuple[Array, Array, Array]:
    """Smoothed means (T, d) and covariances (T, d, d), and expected products (T - 1, d, d) of w_t = x_t - F_t x_(t-1) - f_t.

    Args:
        walk: The transitions around 0, N(f_t + F_t x_(t-1), S_t^-1).
        expansion: Log-likelihood of each frame.
        ridge: Ridge of the factorisation, in units of the diagonal.
    """
    prior, gradient = quadratic_prior(walk, jnp.zeros_like(walk.means))
    factor = block_cholesky(prior._replace(diagonal=prior.diagonal + expansion.information), ridge=ridge)
    means, (own, beside) = solve(factor, gradient + expansion.vector), marginal_covariances(factor)
    kept = walk.jacobians[1:]
    moved = means[1:] - jnp.einsum("tij,tj->ti", kept, means[:-1]) - walk.means[1:]
    across = kept @ jnp.swapaxes(beside, 1, 2)
    covariance = own[1:] + kept @ own[:-1] @ jnp.swapaxes(kept, 1, 2) - across - jnp.swapaxes(across, 1, 2)
    return means, own, covariance + moved[:, :, None] * moved[:, None, :]
