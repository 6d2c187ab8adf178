"""Functions and scores of single particles whose batched form keeps the batch in the last axis.

``jax.vmap`` batches a function operation by operation. Concatenations, gathers and products of small matrices then move the
batch axis to the front. Every memory access of a 3x3 product becomes strided, and nothing vectorises. Here the batched form is
written by hand with the particles in the last axis, and a custom rule of ``jax.vmap`` uses it.

:func:`batch_last` gives no reverse gradient. In :func:`batched_score` the gradient is a batch-last function too:
the scores of different particles do not depend on each other, so that one backward pass through their sum gives all
gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from math import prod
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import jit

Tree = Any

_LANES = 8
"""Batches are filled up to a multiple of this: left-over particles run one by one, so that 30 take longer than 32."""
_PICTURE = 2**11
"""Numbers of an argument from which on it is a picture, of which no particle gets a copy."""


def batch_last(function: Callable[..., Tree], *, chunk: int | None = None) -> Callable[..., Tree]:
    """Make a single-particle function of one that is written for a batch in the last axis.

    Args:
        function: Takes pytrees whose leaves have shape (..., N) or (..., 1), where 1 is shared by all particles. Returns a
            pytree with leaves (..., N).
        chunk: Larger batches are cut into pieces of so many particles, one after the other: where a function makes many numbers
            of each particle, those of a piece stay in the cache.

    Returns:
        A function of the same pytrees without the last axis. Any nesting of ``jax.vmap`` around it becomes one call of
        ``function`` with one flattened batch axis; over pictures, as of the frames of a recording, with one call for each.
        Its derivatives, in either direction and of any order, are those of ``function`` for one particle after the other.
    """
    compiled = jit(function)  # traced once for each shape, however often a model's programs run

    @jax.custom_batching.custom_vmap
    def batched(*args: Tree) -> Tree:  # leaves (N or 1, ...)
        count = max(leaf.shape[0] for leaf in jax.tree.leaves(args))
        last = jax.tree.map(lambda leaf: _fill_up(jnp.moveaxis(leaf, 0, -1), _LANES if chunk is None else chunk), args)
        out = compiled(*last) if chunk is None or count <= chunk else _in_chunks(compiled, last, chunk)
        return jax.tree.map(lambda leaf: jnp.moveaxis(leaf[..., :count], -1, 0), out)

    @batched.def_vmap
    def _rule(size: int, is_batched: Any, *args: Tree) -> tuple[Tree, Tree]:
        leaves, treedef = jax.tree.flatten(args)
        flags = jax.tree.leaves(tuple(is_batched))
        if any(flag and prod(leaf.shape[2:]) >= _PICTURE for leaf, flag in zip(leaves, flags, strict=True)):
            out = _in_turn(lambda row: batched(*jax.tree.unflatten(treedef, row)), leaves, flags)
            return out, jax.tree.map(lambda _: True, out)
        inner = max(leaf.shape[int(flag)] for leaf, flag in zip(leaves, flags, strict=True))
        merged = [_merge(leaf, flag, size, inner) for leaf, flag in zip(leaves, flags, strict=True)]
        out = batched(*jax.tree.unflatten(treedef, merged))
        out = jax.tree.map(lambda leaf: leaf.reshape(size, inner, *leaf.shape[1:]), out)
        return out, jax.tree.map(lambda _: True, out)

    @jax.custom_jvp
    def single(*args: Tree) -> Tree:
        out = batched(*jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], args))
        return jax.tree.map(lambda leaf: leaf[0], out)

    def alone(*args: Tree) -> Tree:
        return jax.tree.map(lambda leaf: leaf[..., 0], function(*jax.tree.map(lambda leaf: jnp.asarray(leaf)[..., None], args)))

    @single.defjvp
    def _derivative(args: tuple[Tree, ...], tangents: tuple[Tree, ...]) -> tuple[Tree, Tree]:
        return single(*args), jax.jvp(alone, args, tangents)[1]

    return single


def _in_turn(function: Callable[[list[Array]], Tree], leaves: list[Array], flags: list[bool]) -> Tree:
    """Call a function of leaves for each row of those that are flagged, one after the other; the others are shared."""

    def piece(rows: list[Array]) -> Tree:
        row = iter(rows)
        return function([next(row) if flag else leaf for leaf, flag in zip(leaves, flags, strict=True)])

    return jax.lax.map(piece, [leaf for leaf, flag in zip(leaves, flags, strict=True) if flag])


def _in_chunks(function: Callable[..., Tree], args: Tree, chunk: int) -> Tree:
    """Call a batch-last function for `chunk` particles at a time; leaves of one particle are shared by all."""
    leaves, treedef = jax.tree.flatten(args)
    many = [leaf.shape[-1] > 1 for leaf in leaves]
    pieces = [
        jnp.moveaxis(leaf.reshape(*leaf.shape[:-1], -1, chunk), -2, 0) if own else leaf
        for leaf, own in zip(leaves, many, strict=True)
    ]
    out = _in_turn(lambda row: function(*jax.tree.unflatten(treedef, row)), pieces, many)
    return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2).reshape(*leaf.shape[1:-1], -1), out)


def _fill_up(leaf: Array, lanes: int) -> Array:
    """Repeat the last particle until the batch in the last axis is a multiple of `lanes`; one stays one."""
    missing = -leaf.shape[-1] % lanes
    if leaf.shape[-1] == 1 or not missing:
        return leaf
    return jnp.concatenate([leaf, jnp.broadcast_to(leaf[..., -1:], (*leaf.shape[:-1], missing))], -1)


def _merge(leaf: Array, is_batched: bool, size: int, inner: int) -> Array:
    """Fold a new batch axis of ``size`` into the leading axis of ``inner`` particles; shared leaves stay shared."""
    if not is_batched:
        if leaf.shape[0] == 1:
            return leaf
        leaf = jnp.broadcast_to(leaf, (size, *leaf.shape))
    leaf = jnp.broadcast_to(leaf, (size, inner, *leaf.shape[2:]))
    return leaf.reshape(size * inner, *leaf.shape[2:])


computed_once: Callable[[Any], Any] = jax.lax.optimization_barrier
"""Arrays to the same arrays: the compiler computes them before what follows, and does not fuse them into each of its uses."""


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
