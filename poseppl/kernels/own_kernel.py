"""A custom Markov kernel, in the form of BlackJAX's: `init` and `step`.

Such a kernel takes the place of hybrid Monte Carlo in the tempered filter's moves and in the chains of the HMC filters. It sees
positions in whitened coordinates, in which the density is about as wide in one direction as in another, and may read the step
size that they adapt. BlackJAX's Metropolis-adjusted Langevin algorithm is one as it stands, its NUTS with a mass matrix:

>>> import blackjax
>>> mala = CustomKernel(blackjax.mala.init, blackjax.mala.build_kernel())
>>> nuts_step = blackjax.nuts.build_kernel()
>>> def step(rng_key, state, log_density, step_size):
...     return nuts_step(rng_key, state, log_density, step_size, jnp.ones_like(state.position), 5)
>>> nuts = CustomKernel(blackjax.nuts.init, step)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array


class CustomKernel(NamedTuple):
    """A Markov kernel.

    Attributes:
        init: `(position, log_density) -> state`, of a position (d,); the state has a field ``position``.
        step: `(rng_key, state, log_density, step_size) -> (state, info)`, which leaves the density invariant. The step size
            adapts to the field ``acceptance_rate`` of `info`, and stays where it has none.
    """

    init: Callable[..., Any]
    step: Callable[..., Any]


class Updated(NamedTuple):
    """A state after an update, and how that went.

    Attributes:
        state: The kernel's state.
        acceptance: Acceptance rate; NaN if the kernel does not report one.
        divergent: Whether it diverged.
        evaluations: Evaluations of the density, where the kernel counts them, else 1; int32.
    """

    state: Any
    acceptance: Array
    divergent: Array
    evaluations: Array


def update_by(
    kernel: CustomKernel, rng_key: Array, state: Any, log_density: Callable[[Array], Array], step_size: Array
) -> Updated:
    """Update a state once."""
    new, info = kernel.step(rng_key, state, log_density, step_size)
    count = next((getattr(info, name) for name in ("num_integration_steps", "subiter") if hasattr(info, name)), 1)
    return Updated(
        new,
        jnp.asarray(getattr(info, "acceptance_rate", jnp.nan), state.position.dtype),
        jnp.asarray(getattr(info, "is_divergent", False)),
        jnp.asarray(count, jnp.int32),
    )
