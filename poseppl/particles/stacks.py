"""Trees of arrays stacked along a leading axis, that of the frames: rows of them, and one more row at either end.

>>> stacked = {"x": jnp.arange(6.0).reshape(3, 2), "t": jnp.arange(3)}
>>> tree_index(stacked, -1)["x"].tolist(), append(tree_index(stacked, slice(1)), tree_index(stacked, 2))["t"].tolist()
([4.0, 5.0], [0, 2])
"""

from __future__ import annotations

from typing import Any, TypeVar, cast

import jax
import jax.numpy as jnp

Tree = TypeVar("Tree")


def tree_index(stacked: Tree, index: Any) -> Tree:
    """Rows of every leaf: one for a number, stacked ones for a slice or an array of numbers."""
    return cast(Tree, jax.tree.map(lambda leaf: leaf[index], stacked))


def split_first(stacked: Tree) -> tuple[Tree, Tree]:
    """The first row, and the others stacked."""
    return tree_index(stacked, 0), tree_index(stacked, slice(1, None))


def prepend(one: Tree, stacked: Tree) -> Tree:
    """Every leaf with one more row before the others."""
    return cast(Tree, jax.tree.map(lambda first, others: jnp.concatenate([first[None], others]), one, stacked))


def append(stacked: Tree, one: Tree) -> Tree:
    """Every leaf with one more row after the others."""
    return cast(Tree, jax.tree.map(lambda others, last: jnp.concatenate([others, last[None]]), stacked, one))
