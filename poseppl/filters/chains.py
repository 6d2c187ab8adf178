"""State and effective draws of the filters that run Markov chains within each frame."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.program import CompiledModel, Observation

LogDensity = Callable[[Array], Array]


class ChainState(NamedTuple):
    """State of a filter that runs Markov chains: what the next frame needs.

    Attributes:
        particles: Draws after the warm-up (M, R - b, d).
        log_weights: Log-weights of the draws (M, R - b), up to a constant; those of a chain are equal.
        log_step_size: The adapted log step size.
        started: Whether there has been a frame, a boolean; before the first one `particles` stand for nothing.
    """

    particles: Array
    log_weights: Array
    log_step_size: Array
    started: Array


def chain_state(draws: Array, log_step_size: Array, *, log_weights: Array | None = None, started: bool = True) -> ChainState:
    """Wrap draws (M, R - b, d) of chains of normalised log-weights (M,); None: all chains weigh the same."""
    of_chains = jnp.zeros(len(draws), draws.dtype) if log_weights is None else log_weights - jnp.log(draws.shape[1])
    return ChainState(draws, jnp.broadcast_to(of_chains[:, None], draws.shape[:-1]), log_step_size, jnp.asarray(started))


def mask_failed(model: CompiledModel, observation: Observation, failed: Array) -> Observation:
    """Return the frame's data, or nothing at all where it ``failed``: the frame is then predicted, not updated."""
    kept: Observation = jax.tree.map(lambda nothing, seen: jnp.where(failed, nothing, seen), model.unobserved(), observation)
    return kept


def effective_draws(draws: Array) -> Array:
    """How many independent draws the chains (M, R, d) amount to, from the spread of their means; M to M R, a scalar."""
    num_chains, num_draws, _ = draws.shape
    if num_chains == 1:
        return jnp.ones((), draws.dtype)
    total = jnp.var(draws, (0, 1))
    between = jnp.var(jnp.mean(draws, 1), 0, ddof=1)
    ratio = jnp.mean(total / jnp.maximum(between, 1e-30))
    return num_chains * jnp.clip(ratio, 1.0, num_draws)


def effective_share(log_weights: Array) -> Array:
    """Effective number of chains of normalised log-weights (M,), as a share of M, a scalar."""
    return 1.0 / (len(log_weights) * jnp.sum(jnp.exp(2 * log_weights)))
