r"""The curvature of a whole trajectory's posterior, and its mode.

The joint density of all frames, log p(x_0) + sum_t log p(x_t | x_(t-1)) + sum_t log p(z_t | x_t), has a negative Hessian whose
only blocks lie on the diagonal and next to it. Its Gauss-Newton form is built from parts that are never negative:

* the data of frame t add I_t, `CompiledModel.observation_information`, to block (t, t);
* a transition with Gaussian moments m(x), Q adds (-J, 1)^T Q^(-1) (-J, 1), J = dm / dx, to the blocks of t - 1 and t: a linear
  one the Hessian of -log p(x_t | x_(t-1)), which is the same, without an inverse of Q;
* any other transition adds |H|, the Hessian H of log p(x_t | x_(t-1)) with its eigenvalues made positive, so that heavy tails,
  where they are not negative, still give a scale (Betancourt 2013, doi:10.1007/978-3-642-40020-9_35);
* the first frame adds its precision, or |H|, to block (0, 0).

A Gauss-Newton step x + P(x)^(-1) grad log p(x, z) over all frames is a pass of the iterated Kalman smoother (Bell 1994,
doi:10.1137/0804035); shortened until the density does not fall, such steps climb to a mode.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.extend import core

from poseppl.gaussians.block_tridiagonal import (
    BlockCholesky,
    BlockTridiagonal,
    block_cholesky,
    marginal_covariances,
    solve,
    solve_upper,
)
from poseppl.gaussians.gaussian import precision_of
from poseppl.gaussians.linear_transitions import transition_around, transition_curvature, transition_structure
from poseppl.kernels.laplace import likeliest
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.dependence import output_dependence

R = TypeVar("R")

_LENGTHS = (0.0, 1.0, 1.5, 2.0, 0.5, 0.2, 0.05, 0.01)
"""Multiples of a step that are tried; the best is taken, so that the density never falls. Majorised steps are mostly short."""
_NOTHING = 0.01
"""Nats that a step to a mode has to promise: with less, the mode is within a seventh of a standard deviation."""
_HARDLY = 1e-3
"""Weight of data that hardly count."""
_RIDGE = 8.0
"""On the diagonal of the matrix scaled to a unit diagonal, in units of the type's precision: 1e-6 for float32."""
_FLOOR = 1e-6
"""Least curvature of a coordinate, as a fraction of its largest over the frames."""


def trajectory_precisions(model: CompiledModel, observations: Observation, inputs: Any) -> Callable[..., BlockTridiagonal]:
    """Gauss-Newton curvature of the negative log-density of trajectories (T, d) and their data, as a function of them.

    Parts that do not depend on the trajectory, such as those of a linear walk, are computed here, once for all trajectories.

    Args:
        model: The compiled model; its sites need no Gaussian moments.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, or None.

    Returns:
        ``(xs, spread=None, data_weight=1.0, majorised=False) -> precision``, with ``spread`` (T, d, d) and ``majorised`` as of
        `CompiledModel.observation_information`, and ``data_weight`` as of `CompiledModel.log_joint`.
    """
    prior = _prior_precisions(model, len(jax.tree.leaves(observations.mask)[0]), inputs)

    def precision(
        xs: Array, spread: Array | None = None, data_weight: Array | float = 1.0, majorised: Array | bool = False
    ) -> BlockTridiagonal:
        def information(x: Array, observation: Observation, inputs: Any, spread: Array | None) -> Array:
            return model.observation_information(x, observation, inputs, majorised=majorised, spread=spread)

        data = jax.vmap(information)(xs, observations, inputs, spread)
        diagonal, below = prior(xs)
        return BlockTridiagonal(_floored(diagonal + data_weight * data), below)

    return precision


def average_precision(model: CompiledModel, trajectories: Array, observations: Observation, inputs: Any) -> BlockTridiagonal:
    """Mean of the curvature over trajectories (S, T, d)."""
    each = jax.vmap(trajectory_precisions(model, observations, inputs))(trajectories)
    mean: BlockTridiagonal = jax.tree.map(lambda leaf: jnp.mean(leaf, 0), each)
    return mean


def safe_cholesky(precision: BlockTridiagonal) -> BlockCholesky:
    """Cholesky factor of a precision; the identity where that is not positive definite or not finite."""
    factor = block_cholesky(precision, ridge=_RIDGE * float(np.finfo(precision.diagonal.dtype).eps))
    sound = jnp.all(jnp.isfinite(factor.inverses)) & jnp.all(jnp.isfinite(factor.gains))
    eye = jnp.eye(factor.inverses.shape[1], dtype=factor.inverses.dtype)
    return BlockCholesky(jnp.where(sound, factor.inverses, eye), jnp.where(sound, factor.gains, 0.0))


def find_mode(
    model: CompiledModel, xs: Array, observations: Observation, inputs: Any, num_steps: int, *, majorised: bool = False
) -> Array:
    """Climb from a trajectory (T, d) towards the nearest mode of the joint density by damped Gauss-Newton steps."""
    precision = trajectory_precisions(model, observations, inputs)

    def log_density(xs: Array) -> Array:
        return model.log_joint(xs, observations, inputs)

    def step(xs: Array, _: None) -> tuple[Array, None]:
        return _damped_step(log_density, safe_cholesky(precision(xs, majorised=majorised)), xs)[0], None

    return jax.lax.scan(step, xs, None, length=num_steps)[0]


class _Climb(NamedTuple):
    """A climb from the end of the one before it.

    Attributes:
        weight: Weight of the data.
        is_first: Whether it is from the start.
        is_last: Whether it is the last step to a mode.
    """

    weight: Array
    is_first: Array
    is_last: Array


def climb_to_mode(
    log_density: Callable[[Array, Array], Array],
    factor: Callable[[Array, Array, Array], BlockCholesky],
    start: Array,
    num_steps: int,
) -> tuple[Array, Array]:
    """Climb to the higher of two modes: from where one starts, and from the mode of data that hardly count.

    Data that hardly count leave the prior's modes; where it has one, the second climb does not depend on the start.

    Args:
        log_density: Log-density of a trajectory (T, d) and the weight () of the data.
        factor: The curvature, given the same and whether it is to be majorised: steps by it are seldom too long. The last
            one to a mode, by the curvature itself, goes the rest of the way.
        start: (T, d).
        num_steps: At most, of each climb.

    Returns:
        The mode, and how many steps were gone in all.
    """

    def climb_from(before: Array, row: _Climb) -> tuple[Array, tuple[Array, Array]]:
        def unfinished(carry: tuple[Array, Array, Array]) -> Array:
            _, promised, count = carry
            return (promised > _NOTHING) & (count < jnp.where(row.is_last, 1, num_steps))

        def step(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
            xs, _, count = carry
            curvature = factor(xs, row.weight, ~row.is_last)
            return *_damped_step(lambda xs: log_density(xs, row.weight), curvature, xs), count + 1

        first = jnp.where(row.is_first, start, before), jnp.full_like(row.weight, jnp.inf), jnp.zeros((), int)
        mode, _, count = jax.lax.while_loop(unfinished, step, first)
        return mode, (mode, count)

    rows = _Climb(
        jnp.array([1.0, 1.0, _HARDLY, 1.0, 1.0], start.dtype),
        is_first=jnp.array([True, False, True, False, False]),
        is_last=jnp.array([False, True, False, False, True]),
    )
    _, (modes, counts) = jax.lax.scan(climb_from, start, rows)
    return likeliest(lambda xs: log_density(xs, rows.weight[0]), modes[jnp.array([1, 4])]), jnp.sum(counts)


def at_expected_errors(about: Callable[[Array], tuple[BlockCholesky, R]], mode: Array) -> tuple[BlockCholesky, R]:
    """The curvature about a mode (T, d) at errors as large as its own Gaussian expects them to be, by one correction.

    Args:
        about: The factor of the curvature, and what comes with it, given covariances of the states (T, d, d).
        mode: The mode.
    """
    no_spread = jnp.zeros((*mode.shape, mode.shape[1]), mode.dtype)
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(about, no_spread))

    def correct(_: int, known: tuple[BlockCholesky, R]) -> tuple[BlockCholesky, R]:
        return about(marginal_covariances(known[0]).own)

    known: tuple[BlockCholesky, R] = jax.lax.fori_loop(0, 2, correct, nothing)
    return known


def draws_about(
    model: CompiledModel,
    num_draws: int,
    rng_key: Array,
    mode: Array,
    observations: Observation,
    inputs: Any,
    of_draw: Callable[[Array], Any],
) -> Any:
    """The output for each of S draws of a trajectory by Laplace's approximation about a mode (T, d), with a leading S."""
    factor = safe_cholesky(trajectory_precisions(model, observations, inputs)(mode))

    def draw(key: Array) -> Any:
        return of_draw(mode + solve_upper(factor, jax.random.normal(key, mode.shape, mode.dtype)))

    return jax.lax.map(draw, jax.random.split(rng_key, num_draws))


def _damped_step(log_density: Callable[[Array], Array], factor: BlockCholesky, xs: Array) -> tuple[Array, Array]:
    """A step of Newton's from a trajectory (T, d), by a factor of the curvature, as long as the density likes best.

    Beside it how much, in nats, the whole step promised; 0 where the density likes none.
    """
    gradient = jax.grad(log_density)(xs)
    move = solve(factor, gradient)
    move = jnp.where(jnp.all(jnp.isfinite(move)), move, 0.0)
    new = likeliest(log_density, xs + jnp.asarray(_LENGTHS, xs.dtype)[:, None, None] * move)
    return new, jnp.where(jnp.any(new != xs), 0.5 * jnp.sum(gradient * move), 0.0)


def _prior_precisions(model: CompiledModel, num_frames: int, inputs: Any) -> Callable[[Array], BlockTridiagonal]:
    """The part of the first state and of the transitions, as a function of a trajectory (T, d)."""
    later = tree_index(inputs, slice(1, None))

    def precision(xs: Array) -> BlockTridiagonal:
        before, below, after = jax.vmap(_transition_blocks(model, inputs))(xs[:-1], xs[1:], later)
        diagonal = jnp.zeros((*xs.shape, model.dimension), xs.dtype)
        diagonal = diagonal.at[0].set(_initial_precision(model, xs[0], tree_index(inputs, 0)))
        return BlockTridiagonal(diagonal.at[:-1].add(before).at[1:].add(after), below)

    zero = jnp.zeros((num_frames, model.dimension))
    traced = jax.make_jaxpr(lambda xs: tuple(precision(xs)))(zero)
    evaluate = core.jaxpr_as_fun(traced)
    if any(output_dependence(traced, [frozenset({0})])):
        return lambda xs: BlockTridiagonal(*evaluate(xs))
    fixed = BlockTridiagonal(*evaluate(zero))
    return lambda xs: fixed


def _initial_precision(model: CompiledModel, x: Array, inputs: Any) -> Array:
    if _has_moments(lambda: model.initial_moments(inputs)) and not model.moments_are_linearised("initial", inputs):
        return precision_of(model.initial_moments(inputs)[1])
    return _absolute(_hessian(lambda x: model.log_initial(x, inputs), x))


def _transition_blocks(model: CompiledModel, inputs: Any) -> Callable[..., tuple[Array, Array, Array]]:
    """`(previous, x, inputs) -> blocks (t-1, t-1), (t, t-1), (t, t)`, each (d, d)."""
    d = model.dimension
    first = tree_index(inputs, 0)

    zero = jnp.zeros(d)
    exact = _has_moments(lambda: model.transition_moments(zero, first))
    exact = exact and not model.moments_are_linearised("transition", first, zero)
    linear = exact and transition_structure(model, inputs).linear

    def of_moments(previous: Array, x: Array, inputs: Any) -> tuple[Array, Array, Array]:
        return transition_curvature(*transition_around(model, previous, inputs)[1:])

    def of_density(previous: Array, x: Array, inputs: Any) -> tuple[Array, Array, Array]:
        def log_density(pair: Array) -> Array:
            return model.log_transition(pair[d:], pair[:d], inputs)

        hessian = _hessian(log_density, jnp.concatenate([previous, x]))
        whole = -hessian if linear else _absolute(hessian)
        return whole[:d, :d], whole[d:, :d], whole[d:, d:]

    return of_moments if exact and not linear else of_density


def _has_moments(moments: Callable[[], Any]) -> bool:
    """Whether a program's moments can be read off; nothing is computed."""
    try:
        jax.eval_shape(moments)
    except ValueError:
        return False
    return True


def _hessian(log_density: Callable[[Array], Array], x: Array) -> Array:
    hessian: Array = jax.jacrev(jax.grad(log_density))(x)
    return hessian


def _absolute(hessian: Array) -> Array:
    """A Hessian with its eigenvalues made positive."""
    hessian = jnp.where(jnp.isfinite(hessian), hessian, 0.0)
    values, vectors = jnp.linalg.eigh((hessian + hessian.T) / 2)
    absolute: Array = (vectors * jnp.abs(values)) @ vectors.T
    return absolute


def _floored(diagonal: Array) -> Array:
    """Blocks (T, d, d) without a coordinate of no curvature at all."""
    curvature = jnp.diagonal(diagonal, axis1=1, axis2=2)
    largest = jnp.max(curvature, 0)
    floor = jnp.where(largest > 0, _FLOOR * largest, 1.0)
    missing = jnp.maximum(floor - curvature, 0.0)
    return diagonal + missing[:, :, None] * jnp.eye(diagonal.shape[1], dtype=diagonal.dtype)
