r"""The prior of a whole trajectory as a Gaussian: exact for linear transitions, else linearised around given states.

With x_0 ~ N(m_0, P_0) and x_t given x_(t-1) of mean f_t and covariance Q_t, F_t = d f_t / d x_(t-1), around states mu_t

    -log p(mu + e) ~ e^T J e / 2 - h.e + constant,        J block-tridiagonal:

    J_tt = Q_t^-1 + F_(t+1)^T Q_(t+1)^-1 F_(t+1),     J_(t+1, t) = -Q_(t+1)^-1 F_(t+1),
    h_t = -Q_t^-1 r_t + F_(t+1)^T Q_(t+1)^-1 r_(t+1),     r_t = mu_t - f_t(mu_(t-1)),

with P_0 and m_0 for Q and f at the first frame.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.block_tridiagonal import BlockTridiagonal
from poseppl.gaussians.gaussian import precision_of
from poseppl.gaussians.linearisation import first_order
from poseppl.program import CompiledModel
from poseppl.program.dependence import output_dependence


class LinearTransitions(NamedTuple):
    """The transitions of all frames around states, as x_t ~ N(f + F (x_(t-1) - mu_(t-1)), S^-1).

    Attributes:
        means: f, (T, d); the initial mean at the first frame.
        jacobians: F, (T, d, d); 0 at the first frame.
        precisions: S, inverse covariances (T, d, d).
    """

    means: Array
    jacobians: Array
    precisions: Array


class Structure(NamedTuple):
    """Whether a transition's mean is affine in the state and in sites of its own frame, and its covariance constant."""

    affine: bool
    constant: bool

    @property
    def linear(self) -> bool:
        """Whether a Gaussian of these moments is linear."""
        return self.affine and self.constant


def transition_structure(model: CompiledModel, inputs: Any) -> Structure:
    """Read from a program what its transition's moments depend on.

    Args:
        model: The compiled model, its transition with Gaussian moments.
        inputs: Stacked inputs with leading T, or None.

    Raises:
        ValueError: The transition has no Gaussian moments.
    """
    row, zero = jax.tree.map(lambda a: a[0], inputs), jnp.zeros(model.dimension)
    found = _structure(lambda x: model.transition_moments(x, row), zero)
    return found._replace(affine=found.affine and not model.moments_are_linearised("transition", row, zero))


def observation_structure(model: CompiledModel, inputs: Any) -> Structure:
    """The same of an observation, which has Gaussian moments."""
    row = jax.tree.map(lambda a: a[0], inputs)
    return _structure(lambda x: model.observation_moments(x, row), jnp.zeros(model.dimension))


def _structure(moments: Callable[[Array], tuple[Array, Array]], zero: Array) -> Structure:
    """Whether the mean is linear in the state (d,), and whether the covariance is independent of it."""

    def parts(x: Array) -> Any:
        return jax.jacrev(lambda x: moments(x)[0])(x), moments(x)[1]

    jacobian, covariance = output_dependence(jax.make_jaxpr(parts)(zero), [frozenset({0})])
    return Structure(not jacobian, not covariance)


def linear_transitions(model: CompiledModel, states: Array, inputs: Any) -> LinearTransitions:
    """Linearise all transitions around states (T, d).

    Raises:
        ValueError: The programs have no Gaussian moments.
    """
    d = states.shape[1]
    mean, covariance = model.initial_moments(jax.tree.map(lambda a: a[0], inputs))
    first = LinearTransitions(mean[None], jnp.zeros((1, d, d), states.dtype), precision_of(covariance)[None])
    if states.shape[0] == 1:
        return first

    def one(x: Array, row_inputs: Any) -> LinearTransitions:
        return transition_around(model, x, row_inputs)

    later = jax.vmap(one)(states[:-1], jax.tree.map(lambda a: a[1:], inputs))
    whole: LinearTransitions = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), first, later)
    return whole


def transition_around(model: CompiledModel, x: Array, inputs: Any) -> LinearTransitions:
    """Linearise one transition around the state (d,) that it starts from."""
    mean, jacobian, covariance = first_order(lambda x: model.transition_moments(x, inputs), x)
    return LinearTransitions(mean, jacobian, precision_of(covariance))


def transition_curvature(jacobian: Array, precision: Array) -> tuple[Array, Array, Array]:
    """The curvature (-F, 1)^T S (-F, 1) of a linearised transition in (x_(t-1), x_t), which is never negative.

    Args:
        jacobian: F (d, d).
        precision: S (d, d).

    Returns:
        The blocks (t-1, t-1), (t, t-1) and (t, t), each (d, d).
    """
    pulled = precision @ jacobian
    return jacobian.T @ pulled, -pulled, precision


def quadratic_prior(transitions: LinearTransitions, states: Array) -> tuple[BlockTridiagonal, Array]:
    """J and h (T, d) around the states (T, d) that the transitions were linearised at."""
    means, jacobians, precisions = transitions
    force = jnp.einsum("tij,tj->ti", precisions, states - means)
    before, below, _ = jax.vmap(transition_curvature)(jacobians[1:], precisions[1:])
    gradient = (-force).at[:-1].add(jnp.einsum("tji,tj->ti", jacobians[1:], force[1:]))
    return BlockTridiagonal(precisions.at[:-1].add(before), below), gradient
