"""Gibbs sampling: a kernel of named blocks, each moved given the others by a draw of one's own or by a kernel of BlackJAX's.

A position is a dict of arrays by name. A step moves one block after the other. A block is

* a function `(rng_key, position) -> value` that draws the block from its conditional distribution, or moves it so that this
  stays invariant, as a conditional particle filter does; integers are drawn like this;
* or a :class:`~poseppl.kernels.own_kernel.CustomKernel`, for conditionals that are not conjugate: it moves on the joint density
  as a function of the block, and may be any of BlackJAX's.

>>> import blackjax
>>> blocks = {
...     "label": lambda rng_key, x: jax.random.bernoulli(rng_key, jax.nn.sigmoid(2.0 * x["centre"])).astype(int),
...     "centre": CustomKernel(blackjax.mala.init, blackjax.mala.build_kernel()),
... }
>>> def log_density(x):  # the label is 1 or 0, the centre's mean 1 or -1
...     return -0.5 * (x["centre"] - 2.0 * x["label"] + 1.0) ** 2
>>> kernel = gibbs_kernel(blocks)
>>> state = kernel.init({"label": jnp.asarray(0), "centre": jnp.asarray(0.0)}, log_density)
>>> state, info = kernel.step(jax.random.key(0), state, log_density, 0.5)
>>> sorted(state.position), list(info)
(['centre', 'label'], ['centre'])
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.kernels.own_kernel import CustomKernel, update_by

Position = dict[str, Any]
ConditionalDraw = Callable[[Array, Position], Any]


class GibbsState(NamedTuple):
    """A position: arrays by the name of their block."""

    position: Position


def gibbs_kernel(blocks: Mapping[str, ConditionalDraw | CustomKernel]) -> CustomKernel:
    """A kernel that moves blocks in turn, in the order given.

    Args:
        blocks: A draw or a kernel by name of the block.

    Returns:
        The kernel. Its `step` takes a step size of all blocks' kernels, or one by name. Beside the state it returns an
        :class:`~poseppl.kernels.own_kernel.Updated` of each block with a kernel, by name. Its `init` raises ``ValueError`` if
        the position's names are not those of the blocks.
    """

    def init(position: Mapping[str, Any], log_density: Callable[[Position], Array]) -> GibbsState:
        if set(position) != set(blocks):
            raise ValueError(f"position: its names are {sorted(position)}. Give those of the blocks, {sorted(blocks)}.")
        return GibbsState({name: jnp.asarray(value) for name, value in position.items()})

    def step(rng_key: Array, state: GibbsState, log_density: Callable[[Position], Array], step_size: Any) -> Any:
        position, moves = dict(state.position), {}
        for key, (name, block) in zip(jax.random.split(rng_key, len(blocks)), blocks.items(), strict=True):
            if not isinstance(block, CustomKernel):
                position[name] = block(key, dict(position))
                continue
            conditional = _conditional(log_density, dict(position), name)
            own = step_size[name] if isinstance(step_size, Mapping) else step_size
            moves[name] = update_by(block, key, block.init(position[name], conditional), conditional, own)
            position[name] = moves[name].state.position
        return GibbsState(position), moves

    return CustomKernel(init, step)


def _conditional(log_density: Callable[[Position], Array], others: Position, name: str) -> Callable[[Any], Array]:
    """The joint density as a function of one block."""
    return lambda value: log_density({**others, name: value})
