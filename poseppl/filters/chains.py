"""What the filters that run Markov chains within each frame share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from poseppl.program import CompiledModel, Observation

LogDensity = Callable[[jax.Array], jax.Array]


class ChainState(NamedTuple):
    """What the next frame needs.

    Attributes:
        particles: Draws after burn-in (M, R - b, d).
        log_weights: Zeros (M, R - b): all draws count alike.
        log_step_size: The adapted log step size.
    """

    particles: jax.Array
    log_weights: jax.Array
    log_step_size: jax.Array


def chain_state(draws: jax.Array, log_step_size: jax.Array) -> ChainState:
    """Wrap equally weighted draws (M, R - b, d)."""
    return ChainState(draws, jnp.zeros(draws.shape[:-1], draws.dtype), log_step_size)


def drop_impossible(model: CompiledModel, observation: Observation, failed: jax.Array) -> Observation:
    """Return the frame's data, or nothing at all where it ``failed``: the frame is then predicted, not updated."""
    return jax.tree.map(lambda nothing, seen: jnp.where(failed, nothing, seen), model.unobserved(), observation)


def initial_moments(
    model: CompiledModel, rng_key: jax.Array, inputs: Any, num_draws: int = 1024
) -> tuple[jax.Array, jax.Array]:
    """Mean (d,) and covariance (d, d) of the initial state, estimated from draws."""
    draws = jax.vmap(lambda k: model.sample_initial(k, inputs))(jax.random.split(rng_key, num_draws))
    return moments(draws)


def moments(draws: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Mean (d,) and covariance (d, d) of equally weighted draws (N, d)."""
    mean = jnp.mean(draws, 0)
    centred = draws - mean
    return mean, centred.T @ centred / max(draws.shape[0] - 1, 1)
