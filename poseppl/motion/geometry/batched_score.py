"""Scores of single particles, written for a batch in the last axis, with a gradient.

:func:`poseppl.motion.geometry.batch_last.batch_last` gives no reverse gradient. Here the gradient is a batch-last function too:
the scores of different particles do not depend on each other, so that one backward pass through their sum gives all
gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last

Tree = Any


def batched_score(function: Callable[..., Array], *, chunk: int) -> Callable[..., Array]:
    """Make a differentiable single-particle function of a batch-last score.

    Args:
        function: Takes the state (d, N) and then pytrees with leaves (..., N or 1); returns scores (..., N).
        chunk: So many particles at a time.

    Returns:
        A function of a state (d,) and the same pytrees without the last axis, which returns (...,). It has a reverse gradient
        with respect to the state; everything else is taken as constant. Any nesting of ``jax.vmap`` becomes one call with a
        flat batch.
    """

    def pulled(state: Array, cotangent: Array, *constants: Tree) -> Array:
        count = max(leaf.shape[-1] for leaf in jax.tree.leaves((state, cotangent, constants)))
        state = jnp.broadcast_to(state, (state.shape[0], count))  # many cotangents, or data, may meet one state
        gradient: Array = jax.grad(lambda moved: jnp.sum(function(moved, *constants) * cotangent))(state)
        return gradient

    forward, backward = batch_last(function, chunk=chunk), batch_last(pulled, chunk=chunk)

    @jax.custom_vjp
    def score(state: Array, *constants: Tree) -> Array:
        found: Array = forward(state, *constants)
        return found

    def keep(state: Array, *constants: Tree) -> tuple[Array, Tree]:
        return score(state, *constants), (state, constants)

    def pull(kept: Tree, cotangent: Array) -> tuple[Any, ...]:
        state, constants = kept
        return (backward(state, cotangent, *constants), *(None for _ in constants))

    score.defvjp(keep, pull)
    return score


def batched_density(function: Callable[..., Array], *, chunk: int) -> Callable[..., Array]:
    """Make a differentiable single-particle function of batch-last densities, found along with their gradients.

    Arguments and result are as in :func:`batched_score`; where the gradient is asked for, one pass gives both, and nothing but
    the gradient is kept.
    """

    def both(state: Array, *constants: Tree) -> tuple[Array, Array]:
        found, pull = jax.vjp(lambda moved: function(moved, *constants), state)
        return found, pull(jnp.ones_like(found))[0]

    alone, together = batch_last(function, chunk=chunk), batch_last(both, chunk=chunk)

    @jax.custom_vjp
    def density(state: Array, *constants: Tree) -> Array:
        found: Array = alone(state, *constants)
        return found

    def pull(kept: Tree, cotangent: Array) -> tuple[Any, ...]:
        gradient, constants = kept
        return (gradient * cotangent, *(None for _ in constants))

    def keep(state: Array, *constants: Tree) -> tuple[Array, Tree]:
        found, gradient = together(state, *constants)
        return found, (gradient, constants)

    density.defvjp(keep, pull)
    return density


def batched_residuals(function: Callable[..., tuple[Array, Array]]) -> Callable[..., Array]:
    """Make single-particle residuals, differentiable by the state, of a batch-last function that knows their derivatives.

    Args:
        function: Takes the state (d, N) and then pytrees with leaves (..., N or 1); returns residuals (n, N) and their
            derivatives (n, d, N).

    Returns:
        A function of a state (d,) and the same pytrees without the last axis, which returns (n,); otherwise as that of
        :func:`batched_score`, but that all rows of a Jacobian are found at once.
    """
    alone, together = batch_last(lambda *arguments: function(*arguments)[0]), batch_last(function)

    @jax.custom_vjp
    def residuals(state: Array, *constants: Tree) -> Array:
        found: Array = alone(state, *constants)
        return found

    def keep(state: Array, *constants: Tree) -> tuple[Array, Tree]:
        found, derivatives = together(state, *constants)
        return found, (derivatives, constants)

    def pull(kept: Tree, cotangent: Array) -> tuple[Any, ...]:
        derivatives, constants = kept
        return (cotangent @ derivatives, *(None for _ in constants))

    residuals.defvjp(keep, pull)
    return residuals
