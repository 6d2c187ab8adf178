r"""Local modes of a density under linear constraints, by a second-order trust region method.

Section 4.1 of Sminchisescu and Triggs 2001 (CVPR): with gradient g and curvature H of the cost f = -log p, a step solves

    (H + lambda W) dx = -g    on the face of the active constraints,

and lambda follows the ratio of the cost's fall to that which the quadratic model promised. W is diagonal: given units of the
coordinates, u, it is the mean of H_ii u_i^2 over u^2, so that no step is long in these units; without, the diagonal of H
(Marquardt 1963, doi:10.1137/0111030), which needs none.

Bounds and rows of a matrix are met exactly: each step solves its quadratic programme by a primal-dual active set method
(Hintermueller, Ito and Kunisch 2002, doi:10.1137/S1052623401383558), which begins with the constraints that the state lies on
and the gradient pulls against. The rest of a step that does not settle is clipped at the bounds and ends at the first row
that it meets. H may be indefinite or singular: where H + lambda W is not positive definite, lambda grows. The cost never rises.

All starts climb side by side, each with a lambda of its own, until all have converged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import cho_factor, cho_solve

from poseppl.compilation import with_full_precision
from poseppl.kernels.constraints import Constraints

LogDensity = Callable[[Array], Array]
Curvature = Callable[[Array], Array]

_FIRST, _MIN, _MAX = 1e-2, 1e-7, 1e9
"""Lambda to start with, and the range that it keeps to; beyond the last a search gives up."""
_FLAT = 1e-6
"""Share of the largest entry of W that every entry has at least."""
_PASSES = 12
"""Times that the active constraints of a step are revised at most."""


class OptimizationResult(NamedTuple):
    """The state of a search, one for each start.

    Attributes:
        states: Shape (d,).
        costs: -log p there, a scalar.
        gradients: Gradient of the cost (d,).
        curvatures: Curvature of the cost (d, d), as the search was given it.
        damping: lambda, a scalar.
        converged: Whether another step would gain less than the tolerance.
        stopped: Whether it converged or gave up.
        evaluations: Times that density, gradient and curvature were evaluated, int32.
    """

    states: Array
    costs: Array
    gradients: Array
    curvatures: Array
    damping: Array
    converged: Array
    stopped: Array
    evaluations: Array


@with_full_precision
def climb_modes(
    starts: Array,
    log_density: LogDensity,
    curvature: Curvature,
    constraints: Constraints,
    *,
    units: Array | None = None,
    num_steps: int = 40,
    tolerance: float = 1e-4,
) -> OptimizationResult:
    """Climb from many starts to local modes, side by side.

    Args:
        starts: Shape (S, d); they are projected onto the constraints.
        log_density: Unnormalised log-density of one state, a scalar.
        curvature: Curvature (d, d) of its negative at one state: Gauss-Newton's, or the Hessian itself, definite or not.
        constraints: Constraints of the states.
        units: Units of the coordinates (d,): changes of about a unit are as long in one coordinate as in another, such as the
            standard deviations of a step of the transition. None takes the curvature for it.
        num_steps: Steps of each start at most; steps that are refused count.
        tolerance: Rise of the log-density that is not worth another step, or eight units in the last place of it.

    Returns:
        The climbs, with a leading axis of S. A start at which the density or its derivatives are not finite stays where it is,
        and has the cost inf.
    """

    def evaluate(x: Array) -> tuple[Array, Array, Array]:
        value, gradient = jax.value_and_grad(log_density)(x)
        hessian = curvature(x)
        usable = jnp.isfinite(value) & jnp.all(jnp.isfinite(gradient)) & jnp.all(jnp.isfinite(hessian))
        return (
            jnp.where(usable, -value, jnp.inf),
            jnp.where(usable, -gradient, 0.0),
            jnp.where(usable, 0.5 * (hessian + hessian.T), jnp.eye(x.shape[0], dtype=x.dtype)),
        )

    def begin(x: Array) -> OptimizationResult:
        x = constraints.project(x)
        no = jnp.zeros((), bool)
        return OptimizationResult(x, *evaluate(x), jnp.asarray(_FIRST, x.dtype), no, no, jnp.ones((), jnp.int32))

    def advance(at: OptimizationResult) -> OptimizationResult:
        step = constrained_step(at, constraints, units)
        after = _judged(at, step, evaluate(step.state), tolerance)
        kept: OptimizationResult = jax.tree.map(lambda new, old: jnp.where(at.stopped, old, new), after, at)
        return kept

    def unfinished(carry: tuple[Array, OptimizationResult]) -> Array:
        return (carry[0] < num_steps) & ~jnp.all(carry[1].stopped)

    def turn(carry: tuple[Array, OptimizationResult]) -> tuple[Array, OptimizationResult]:
        return carry[0] + 1, jax.vmap(advance)(carry[1])

    climbs: OptimizationResult = jax.lax.while_loop(unfinished, turn, (jnp.zeros((), jnp.int32), jax.vmap(begin)(starts)))[1]
    return climbs


class Step(NamedTuple):
    """A step of one climb.

    Attributes:
        state: The end of the step, within all constraints (d,).
        whole: The step on the face, as if nothing but the active constraints were in its way (d,).
        possible: Whether this damping allows a step; otherwise it leads nowhere.
    """

    state: Array
    whole: Array
    possible: Array


def _judged(at: OptimizationResult, step: Step, trial: tuple[Array, Array, Array], tolerance: float) -> OptimizationResult:
    """The climb after a trial, whether or not it was taken."""

    def promise(step: Array) -> Array:
        return -(at.gradients @ step + 0.5 * step @ at.curvatures @ step)

    promised = promise(step.state - at.states)
    gained = jnp.where(jnp.isfinite(trial[0]), at.costs - trial[0], -jnp.inf)
    taken = step.possible & (trial[0] <= at.costs) & jnp.isfinite(trial[0])
    ratio = jnp.where(taken, jnp.where(promised > 0, gained / promised, 1.0), -1.0)
    worthwhile = jnp.maximum(tolerance, 8 * np.finfo(promised.dtype).eps * jnp.abs(at.costs))
    # a step that is short for its damping, or for what it met, says nothing of what another one would gain
    long = step.possible & (at.damping <= 2 * _FIRST) & jnp.isfinite(at.costs)
    converged = long & (jnp.abs(promise(step.whole)) < worthwhile) & (jnp.abs(gained) < worthwhile)
    factor = jnp.where(ratio < 0, 8.0, jnp.where(ratio < 0.25, 3.0, jnp.where(ratio > 0.75, 0.1, 0.5)))
    damping = jnp.maximum(at.damping * factor, _MIN)
    moved = (step.state, *trial)
    kept = at.states, at.costs, at.gradients, at.curvatures
    states, costs, gradients, curvatures = (jnp.where(taken, new, old) for new, old in zip(moved, kept, strict=True))
    stopped = converged | (damping > _MAX)
    return OptimizationResult(states, costs, gradients, curvatures, damping, converged, stopped, at.evaluations + 1)


class Face(NamedTuple):
    """Active constraints, and the step on their face.

    Attributes:
        lower: Coordinates (d,) that are at their lower bounds.
        upper: Coordinates (d,) that are at their upper bounds.
        rows: Rows (m,) that are active.
        step: Shape (d,).
        multipliers: Multipliers of all constraints (d + m,), in the order of `Constraints.normals`: at a constrained minimum of
            the cost, gradient + normals^T multipliers = 0 with multipliers >= 0; 0 where a constraint is not active.
    """

    lower: Array
    upper: Array
    rows: Array
    step: Array
    multipliers: Array


def constrained_step(at: OptimizationResult, constraints: Constraints, units: Array | None) -> Step:
    """The step of one climb."""
    model = at.curvatures + jnp.diag(at.damping * _metric(at.curvatures, units))
    face = active_face(at.states, at.gradients, model, constraints)
    state = jnp.clip(at.states + face.step, constraints.lower, constraints.upper)
    # on the bound itself, and not beside it by a rounding
    state = jnp.where(face.lower, constraints.lower, jnp.where(face.upper, constraints.upper, state))
    possible = jnp.all(jnp.isfinite(face.step))
    if constraints.rows.shape[0]:
        slack, tolerance = constraints.limits - constraints.rows @ at.states, constraints.row_tolerance(at.states)
        toward = constraints.rows @ (state - at.states)
        meets = toward > jnp.maximum(slack, 0.0) + tolerance
        # a step through a row on which it starts must be stopped by it: with more damping it is
        possible = possible & ~jnp.any(meets & (slack <= tolerance))
        share = jnp.min(jnp.where(meets, slack / jnp.where(meets, toward, 1.0), 1.0))
        state = jnp.where(share < 1.0, at.states + share * (state - at.states), state)
    return Step(jnp.where(possible, state, at.states), jnp.where(possible, face.step, 0.0), possible)


def active_face(x: Array, gradient: Array, model: Array, constraints: Constraints) -> Face:
    """The active constraints at a state (d,), and the step to the least value of a quadratic model on their face.

    The model has the cost's gradient (d,) and a positive definite curvature (d, d).

    The sets of active constraints are revised by the solution that they lead to: constraints that it breaks join, those whose
    multipliers pull inward go, until nothing changes.
    """
    lower = (x <= constraints.lower) & (gradient > 0)
    upper = (x >= constraints.upper) & (gradient < 0)
    touched = constraints.limits - constraints.rows @ x <= constraints.row_tolerance(x)
    none = jnp.zeros(x.shape[0] + len(touched), x.dtype)
    first = Face(lower, upper, touched, jnp.zeros_like(x), none)

    def revise(carry: tuple[Array, Face, Face]) -> tuple[Array, Face, Face]:
        turn, _, face = carry
        step, pull, multipliers = _on_face(x, gradient, model, face, constraints)
        beyond = constraints.limits - constraints.rows @ (x + step) < -constraints.row_tolerance(x)
        after = Face(
            (face.lower & (pull > 0)) | (~face.lower & (x + step < constraints.lower)),
            (face.upper & (pull < 0)) | (~face.upper & (x + step > constraints.upper)),
            (face.rows & (multipliers > 0)) | (~face.rows & beyond),
            step,
            none,
        )
        of_bounds = jnp.where(face.lower, pull, 0.0) - jnp.where(face.upper, pull, 0.0)
        multipliers = jnp.maximum(jnp.concatenate([of_bounds, multipliers]), 0.0)
        return turn + 1, face._replace(step=step, multipliers=multipliers), after

    def unsettled(carry: tuple[Array, Face, Face]) -> Array:
        turn, face, after = carry
        changed = [jnp.any(one != other) for one, other in zip(face[:3], after[:3], strict=True)]
        return (turn == 0) | ((turn < _PASSES) & jnp.any(jnp.stack(changed)))

    face: Face = jax.lax.while_loop(unsettled, revise, (jnp.zeros((), jnp.int32), first, first))[1]
    return face


def _on_face(x: Array, gradient: Array, model: Array, face: Face, constraints: Constraints) -> tuple[Array, Array, Array]:
    """The step (d,) to the least value of a quadratic model on a face, the gradient left there, and the rows' multipliers."""
    tiny, eps = np.finfo(x.dtype).tiny, np.finfo(x.dtype).eps
    free = (~(face.lower | face.upper)).astype(x.dtype)
    onto = jnp.where(face.lower, constraints.lower - x, jnp.where(face.upper, constraints.upper - x, 0.0))
    reduced = model * free[:, None] * free + jnp.diag(1.0 - free)
    # scaled to a unit diagonal: millimetres and radians side by side cost float32 its digits
    unit = jax.lax.rsqrt(jnp.maximum(jnp.diagonal(reduced), tiny))
    factor = cho_factor(reduced * unit[:, None] * unit, lower=True)

    def solve(right: Array) -> Any:
        """The inverse of the reduced model times vectors (..., d)."""
        return unit * free * cho_solve(factor, (right * unit * free).T).T

    slope = gradient + model @ onto
    if not len(face.rows):
        step = onto - solve(slope)
        return step, gradient + model @ step, jnp.zeros(0, x.dtype)
    kept = constraints.rows * face.rows[:, None]
    moved = solve(kept)
    schur = kept @ moved.T
    active = face.rows & (jnp.diagonal(schur) > 0)
    size = jnp.where(active, jnp.sqrt(jnp.maximum(jnp.diagonal(schur), tiny)), 1.0)
    # rows that say the same share their multiplier
    scaled = schur / size[:, None] / size * active[:, None] * active + jnp.diag(jnp.where(active, 16 * eps, 1.0))
    excess = constraints.rows @ (x + onto - solve(slope)) - constraints.limits
    multipliers = jnp.linalg.solve(scaled, jnp.where(active, excess, 0.0) / size) / size
    step = onto - solve(slope + kept.T @ multipliers)
    return step, gradient + model @ step + kept.T @ multipliers, multipliers


def _metric(curvature: Array, units: Array | None) -> Array:
    """W (d,), positive everywhere."""
    diagonal = jnp.abs(jnp.diagonal(curvature))
    if units is not None:
        size = jnp.mean(diagonal * units**2)
        return jnp.where(size > 0, size, 1.0) / units**2
    largest = jnp.max(diagonal)
    return jnp.where(largest > 0, jnp.maximum(diagonal, _FLAT * largest), 1.0)
