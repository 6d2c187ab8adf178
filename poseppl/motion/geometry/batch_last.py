"""Single-particle functions whose batched form keeps the batch in the last axis.

``jax.vmap`` batches a function operation by operation. Concatenations, gathers and products of small matrices then move the
batch axis to the front. Every memory access of a 3x3 product becomes strided, and nothing vectorises. Here the batched form is
written by hand with the particles in the last axis, and a custom rule of ``jax.vmap`` uses it.
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
