r"""The scales of a body's velocities, learned from the recording as those of its random walk are.

Velocities are an Ornstein-Uhlenbeck process, integrated (:func:`poseppl.motion.tracking.walk.velocity_steps`): ways and changes
of velocity have variances u_t s_g^2 and (1 - h_t^2) s_g^2, with one scale for each group of coordinates. Expectation
maximisation (:mod:`poseppl.motion.tracking.walk_learning`) in poses and velocities makes s_g^2 the mean of their expected
squares, and of the first velocity's, in units of u_t, of 1 - h_t^2 and of 1.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from threadpoolctl import threadpool_limits

from poseppl.arrays import Floats
from poseppl.gaussians.gaussian import precision_of
from poseppl.gaussians.linear_transitions import LinearTransitions
from poseppl.motion.bodies.body import Velocities
from poseppl.motion.tracking.problem import Problem, body_inputs
from poseppl.motion.tracking.recorded_velocities import learned_paces, seen_poses, without_constants
from poseppl.motion.tracking.walk import VELOCITY_LASTS, velocity_steps
from poseppl.motion.tracking.walk_learning import (
    NARROWEST,
    NUM_ROUNDS,
    WIDEST,
    Expansion,
    check_walk,
    expand,
    expected_innovations,
    groups_of,
    learned_scales,
    reversion,
)
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.runs.run import Constant
from poseppl.smoothers import smoothed_moments
from poseppl.stored_programs import stored_jit

_RIDGE = 1e-6
"""Ridge of a trajectory's precision, in units of its diagonal; about eight times the rounding error of float32."""
Units = tuple[Array, Array, Array]
"""Share of velocities that a frame keeps, its displacement along each, and their standard deviation, as in
``velocity_steps``."""


def with_velocities(problem: Problem, seconds: Floats, start: Floats | None = None) -> Any:
    """The inputs of a problem's body, with the velocities that its data are most likely under.

    Args:
        problem: The problem, with the body's own steps.
        seconds: To each frame from the one before (T,).
        start: Poses (T, d) to start from, of all coordinates; those of an extended Kalman smoother if None.

    Raises:
        InputError: As of :func:`poseppl.motion.tracking.walk_learning.learn_walk`.
    """
    own = body_inputs(problem.inputs)
    kept, step, way = velocity_steps(seconds)
    speeds = jnp.asarray(own.step_scale[0] / np.sqrt(2 * VELOCITY_LASTS * seconds[0]), float)  # that go as far in a long time
    whole = jnp.ones_like(speeds)
    if len(seconds) > 1 and start is not None:
        whole = jnp.asarray(_recorded(problem, np.asarray(speeds, np.float64), (kept, step, way), start), float)
    elif len(seconds) > 1:
        units = tuple(jnp.asarray(each, float) for each in (kept, step, way))
        whole = learned_scales(problem, lambda *known: _learn(*known[:3], speeds, units, *known[3:]))
    scale = speeds * whole
    velocities = Velocities(Constant(scale), jnp.asarray(kept, float), jnp.asarray(step, float))
    return own._replace(step_scale=jnp.asarray(way, float)[:, None] * scale, velocities=velocities)


def _recorded(problem: Problem, speeds: Floats, units: tuple[Floats, Floats, Floats], start: Floats) -> Floats:
    """Scales (d,) of all coordinates in units of the speeds (d,), about poses (T, d) that are known."""
    check_walk(problem)
    own = without_constants(body_inputs(problem.inputs))
    seen, groups = seen_poses(own, problem.observations), groups_of(problem.body)
    with threadpool_limits(limits=1, user_api="blas"):  # threads of small matrices wait for each other, and spin
        return learned_paces(own, seen, start, groups, speeds, units)


@partial(stored_jit, num_static=3)
def _learn(
    model: CompiledModel,
    groups: tuple[int, ...],
    free: tuple[int, ...],
    speeds: Array,
    units: Units,
    observations: Observation,
    inputs: Any,
) -> Array:
    """Scales (d,) of all coordinates in units of the speeds (d,); 1 where they are clamped."""
    kept, _, way = units
    own, group, d = speeds[jnp.asarray(free)], jnp.asarray(groups), len(free)
    turn = _whitening(_along(units, reversion(body_inputs(inputs), free)[0])[1:])
    members = jnp.bincount(group, length=max(groups) + 1)

    def update(_: int, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        scales, trajectory = carry
        walk = velocity_walk(model, own * scales[group], units, free, inputs)
        expansion = Expansion(*(_padded(each, d) for each in expand(model, trajectory, observations, inputs)))
        means, covariances, products = expected_innovations(walk, expansion, _RIDGE)
        squares = jnp.einsum("tij,tjk,tik->ti", turn, products, turn)
        first = means[0, d:] ** 2 + jnp.diagonal(covariances[0])[d:]
        each = (squares[:, :d] / way[1:, None] ** 2 + squares[:, d:] / (1 - kept[1:, None] ** 2)).sum(0) + first
        variance = jnp.zeros_like(scales).at[group].add(each / own**2) / members / (2 * len(kept) - 1)
        new = jnp.sqrt(jnp.clip(variance, NARROWEST**2, WIDEST**2))
        fine = jnp.all(jnp.isfinite(new)) & jnp.all(jnp.isfinite(means))
        return jnp.where(fine, new, scales), jnp.where(fine, means[:, :d], trajectory)

    start = smoothed_moments(model, observations, inputs).mean
    scales, _ = jax.lax.fori_loop(0, NUM_ROUNDS, update, (jnp.ones_like(members, own.dtype), start))
    return jnp.ones_like(speeds).at[jnp.asarray(free)].set(scales[group])


def _padded(values: Array, width: int) -> Array:
    """Values (T, d) or (T, d, d) of poses as those of poses and velocities."""
    return jnp.pad(values, ((0, 0), *((0, width) for _ in values.shape[1:])))


def velocity_walk(model: CompiledModel, scale: Array, units: Units, free: tuple[int, ...], inputs: Any) -> LinearTransitions:
    """Transitions, around 0, of poses and velocities (d,) each, in a state (2 d,)."""
    kept, _, way = units
    left, offset = reversion(body_inputs(inputs), free)
    mean, covariance = model.initial_moments(tree_index(inputs, 0))
    blank = jnp.zeros_like(covariance)

    def jacobian(left: Array, along: Array, kept: Array) -> Array:
        return jnp.block([[jnp.diag(left), (1 + kept) * jnp.diag(along)], [blank, kept * jnp.eye(len(scale))]])

    def precision(turn: Array, variance: Array) -> Array:
        return turn.T @ (turn / variance[:, None])

    variances = jnp.concatenate([way[:, None] ** 2 * scale**2, (1 - kept[:, None] ** 2) * scale**2], 1)
    first = jnp.block([[precision_of(covariance), blank], [blank, jnp.diag(scale**-2)]])
    return LinearTransitions(
        _padded(offset.at[0].set(mean), len(scale)),
        jax.vmap(jacobian)(left, _along(units, left), kept).at[0].set(0.0),
        jax.vmap(precision)(_whitening(_along(units, left)), variances).at[0].set(first),
    )


def _along(units: Units, left: Array) -> Array:
    """How far a pose goes along each velocity (T, d), seconds, where the walk leaves so much of it (T, d)."""
    return left * units[1][:, None]


def _whitening(along: Array) -> Array:
    """(T, 2 d, 2 d), which leaves of a pose's innovation what the velocity's does not make."""
    return jax.vmap(lambda each: jnp.eye(2 * len(each)) - jnp.diag(each, k=len(each)))(along)
