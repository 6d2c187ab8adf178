"""The params of a detector and of its points' motion, from the recording: where its evidence and their prior are largest.

The detector's are fitted first, with points that may be anywhere in each frame: errors are then what the cameras disagree on.
The motion's follow, given these. Fitted together, autocorrelated errors would absorb movement that all cameras agree on but
the motion's program does not predict.

The evidence is Laplace's (:mod:`poseppl.smoothers.laplace`), its ascent BFGS's in coordinates in which the prior is
standard normal. Nothing but what the cameras saw goes in: neither truth nor cameras that are held out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array
from numpy.typing import NDArray

from poseppl.arrays import Floats, Integers
from poseppl.compilation import jit
from poseppl.motion.bodies.body import PointInputs
from poseppl.motion.points.named_points import BY_POINT, PointProblem
from poseppl.program import CompiledModel, Observation
from poseppl.program.parameters import ParameterBijector, parameter_bijector
from poseppl.smoothers.curvature import find_mode
from poseppl.smoothers.laplace import laplace_evidence
from poseppl.stored_programs import stored_jit

OF_A_POINT = ("log_scale", "log_speed")
"""Params of which each point has its own."""
OF_MOTION = ("log_speed", "log_speed_lasts")
"""Params of the points' motion; the others are the detector's."""
NUM_ROUNDS, NUM_STEPS = 2, 15
"""Rounds of an ascent, and its steps in each."""
MODE_STEPS, NEAR_STEPS = 5, 2
"""Steps to the mode under new params, and under draws of the posterior about those that it was found under."""
NUM_DRAWS = 20
"""Draws of the detector's params."""
_DIFFERENCE = 0.03
"""Step of params with a standard normal prior, for the curvature of the evidence."""
_ANYWHERE = 100.0
"""How far a point goes from frame to frame that may be anywhere, px."""
_FARTHEST, _REACH = 5.0, 1.5
"""Standard deviations of the prior within which params are sought, and that they go in a round."""
_WORST = 1e12
NO_CLUTTER, GAUSSIAN = -50.0, 1000.0
"""Log-odds of clutter, and degrees of freedom, on the way to a mode."""


class PointParams(NamedTuple):
    """Params of points and of their detector.

    Attributes:
        params: The likeliest by name, those of single points (K,).
        draws: Draws (D, ...) of the posterior of the detector's around them; those of motion are the likeliest.
    """

    params: dict[str, Array]
    draws: dict[str, Array]


def fit_points(
    problem: PointProblem,
    known: Mapping[str, float] | None = None,
    *,
    num_draws: int = NUM_DRAWS,
    seed: int = 0,
    num_rounds: int = NUM_ROUNDS,
    num_steps: int = NUM_STEPS,
) -> PointParams:
    """Find the params that the data are most likely under: the detector's, then the motion's.

    Args:
        problem: The problem.
        known: Params of the detector that are not sought.
        num_draws: D.
        seed: Seed of the draws.
        num_rounds: Rounds of each ascent.
        num_steps: Its steps in each.
    """
    names = parameter_bijector(problem.whole)
    prior = prior_moments(problem.whole, names)
    sites = np.array([name.partition("[")[0] for name in names.coordinate_names])
    elapsed = np.asarray(problem.inputs.elapsed)  # of the first frame a second, before which is nothing
    step = float(np.median(elapsed[1:] if len(elapsed) > 1 else elapsed))
    anywhere = {"log_speed": np.log(_ANYWHERE / step), "log_speed_lasts": np.log(step)}
    u = prior[0].copy()
    for name, value in {**anywhere, **(known or {})}.items():
        u[sites == name] = value
    motion = np.isin(sites, OF_MOTION)
    detector = _Ascent(problem, prior, u, ~motion & ~np.isin(sites, list(known or {})))
    v = detector.climb(num_rounds, num_steps)
    spread = detector.draws(v, num_draws, seed)
    u = detector.at(v)
    moving = _Ascent(problem, prior, np.where(motion, prior[0], u), motion)
    u = moving.at(moving.climb(num_rounds, num_steps))
    drawn = [names.to_params(jnp.asarray(np.where(motion, u, detector.at(each)))) for each in spread]
    return PointParams(dict(names.to_params(jnp.asarray(u))), jax.tree.map(lambda *each: jnp.stack(each), *drawn))


class _Ascent:
    """Free ones of the unconstrained params u (p,), as v in which their prior is standard normal; the others stay."""

    def __init__(self, problem: PointProblem, prior: tuple[Floats, Floats], u: Floats, free: NDArray[np.bool_]):
        self.problem, self.u, self.free = problem, u, free
        self.mean, self.scale = (moment[free] for moment in prior)
        self.names = parameter_bijector(problem.whole)

    def at(self, v: Floats) -> Floats:
        """The params u (p,)."""
        there = self.u.copy()
        there[self.free] = self.mean + self.scale * v
        return there

    def mode(self, v: Floats, states: Array | None) -> Array:
        """The states (K, T, d) that are likeliest."""
        return points_mode(self.problem, self.names.to_params(jnp.asarray(self.at(v))), states)

    def loss(self, v: Floats, states: Array) -> tuple[float, Floats]:
        """Minus the log-density, and its gradient, with states sought from these."""
        of = self.problem
        u = jnp.asarray(self.at(v))
        value, gradient = value_and_gradient(of.model, of.whole, u, self.mode(v, states), of.observations, of.inputs)
        slope = np.asarray(gradient)[self.free] * self.scale
        sound = bool(np.isfinite(value)) and bool(np.isfinite(slope).all())
        return (-float(value), -slope) if sound else (_WORST, np.zeros_like(slope))

    def climb(self, num_rounds: int, num_steps: int) -> Floats:
        """The likeliest v; in a round all states are sought from the same ones."""
        v, states = (self.u[self.free] - self.mean) / self.scale, None
        for _ in range(num_rounds):
            states = self.mode(v, states)
            bounds = np.clip([v - _REACH, v + _REACH], -_FARTHEST, _FARTHEST).T
            options = {"maxiter": num_steps}
            v = scipy.optimize.minimize(self.loss, v, states, jac=True, method="L-BFGS-B", bounds=bounds, options=options).x
        return np.asarray(v)

    def draws(self, v: Floats, count: int, seed: int) -> Floats:
        """Draws (count, n) about the likeliest v, by the curvature there, which is never less than the prior's."""
        states = self.mode(v, None)
        here = self.loss(v, states)[1]
        curvature = np.array([(self.loss(v + step, states)[1] - here) / _DIFFERENCE for step in _DIFFERENCE * np.eye(len(v))])
        values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
        root = vectors / np.sqrt(np.maximum(values, 1.0))
        return np.asarray(v + np.random.default_rng(seed).normal(size=(count, len(v))) @ root.T)


def prior_moments(whole: CompiledModel, names: ParameterBijector) -> tuple[Floats, Floats]:
    """Means and standard deviations (p,) of a prior of independent normal params, read off its density."""
    zero = jnp.zeros(names.dimension)
    slope = jax.grad(lambda u: names.log_prior(whole, u))
    gradient, curvature = jax.jvp(slope, (zero,), (jnp.ones_like(zero),))
    return np.asarray(-gradient / curvature), np.asarray(1 / jnp.sqrt(-curvature))


def points_mode(
    problem: PointProblem, params: Mapping[str, Array], states: Array | None = None, num_steps: int = MODE_STEPS
) -> Array:
    """Climb to the mode (K, T, d) of each point.

    Without states (K, T, d) to climb from, the way is by errors that are nearly Gaussian and Student-t ones without clutter:
    where all of a point's data are taken for clutter is a mode, too, which is not to be climbed from far away.
    """
    model, observations, inputs = problem.model, problem.observations, problem.inputs
    if states is not None:
        mode: Array = _modes(model, num_steps, dict(params), states, observations, inputs)
        return mode
    tame = dict(params) | {"clutter": jnp.full_like(params["clutter"], NO_CLUTTER)}
    nearly = inputs._replace(freedom=GAUSSIAN * jnp.ones_like(inputs.freedom))
    states = problem.start
    for start, each in ((tame, nearly), (tame, inputs), (dict(params), inputs)):
        states = _modes(model, num_steps, start, states, observations, each)
    return states


def under_draws(draws: Mapping[str, Array], num_draws: int) -> list[Integers]:
    """For each of D draws of params, which is wanted once or more, its number for each draw of places under it: S in all."""
    count = len(next(iter(draws.values())))
    rows = np.arange(num_draws) // -(-num_draws // count)
    return np.split(rows, np.flatnonzero(np.diff(rows)) + 1)


def params_by_point(params: Mapping[str, Array]) -> tuple[dict[str, Array], dict[str, Any]]:
    """Params with a leading axis of points where points have their own, each (1,), and which do, for ``vmap``."""
    split = {name: value[:, None] if name in OF_A_POINT else value for name, value in params.items()}
    return split, {name: 0 if name in OF_A_POINT else None for name in params}


@partial(stored_jit, num_static=2, lightly=False)
def _modes(
    model: CompiledModel,
    num_steps: int,
    params: dict[str, Array],
    states: Array,
    observations: Observation,
    inputs: PointInputs,
) -> Array:
    split, axes = params_by_point(params)

    def one(params: Any, xs: Array, observations: Observation, inputs: PointInputs) -> Array:
        return find_mode(model.with_params(params), xs, observations, inputs, num_steps, majorised=True)

    return jax.vmap(one, in_axes=(axes, 0, 0, BY_POINT))(split, states, observations, inputs)


@partial(jit, static_argnums=(0, 1))
def value_and_gradient(
    model: CompiledModel, whole: CompiledModel, u: Array, states: Array, observations: Observation, inputs: PointInputs
) -> tuple[Array, Array]:
    """Log-evidence and log-prior of unconstrained params (p,), summed, around states (K, T, d), with the gradient."""
    names = parameter_bijector(whole)

    def total(u: Array) -> Array:
        split, axes = params_by_point(names.to_params(u))

        def one(params: Any, xs: Array, observations: Observation, inputs: PointInputs) -> Array:
            return laplace_evidence(model.with_params(params), xs, observations, inputs, num_steps=2, majorised=True)

        each = jax.vmap(one, in_axes=(axes, 0, 0, BY_POINT))(split, states, observations, inputs)
        return jnp.sum(each) + names.log_prior(whole, u)

    return jax.value_and_grad(total)(u)
