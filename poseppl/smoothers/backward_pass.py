r"""The backward pass through a filter's history, from the last frame to the first, in indices of particles.

A step draws, for the particles chosen at frame t + 1, particles of frame t. In backward simulation (Godsill, Doucet and West
2004, doi:10.1198/016214504000000151) particle i is drawn with probability proportional to w_t^i p(x_(t+1) | x_t^i).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel
from poseppl.program.population import log_transitions_into


class Earlier(NamedTuple):
    """A frame that a step draws from, and the next one.

    Attributes:
        particles: Shape (N, d).
        log_weights: Shape (N,).
        later: Particles of the next frame (N, d).
        ancestors: Those of the next frame.
        inputs: Those of the next frame.
    """

    particles: Array
    log_weights: Array
    later: Array
    ancestors: Array
    inputs: Any


Step = Callable[[Array, Array, Earlier], tuple[Array, Any]]
"""`(key, chosen, frame) -> (earlier, anything)`, indices of any shape."""


def backward_pass(
    step: Step,
    keys: Array,
    particles: Array,
    log_weights: Array,
    ancestors: Array,
    inputs: Any,
    last: Array,
) -> tuple[Array, Any]:
    """Go back from the particles `last` of the last frame.

    Args:
        step: From frame to frame.
        keys: PRNG keys (T - 1,), or numbers that the step folds into a key of its own.
        particles: Shape (T, N, d).
        log_weights: Shape (T, N).
        ancestors: Shape (T, ...); those of the first frame are not read.
        inputs: Inputs with a leading T, or None.
        last: Indices of any shape.

    Returns:
        Indices (T, ...), and what else the steps returned, stacked (T - 1, ...).
    """
    later = tree_index((particles, ancestors, inputs), slice(1, None))
    frames = Earlier(particles[:-1], log_weights[:-1], *later)

    def back(chosen: Array, row: tuple[Array, Earlier]) -> tuple[Array, Any]:
        earlier, outputs = step(row[0], chosen, row[1])
        return earlier, (earlier, outputs)

    _, (earlier, outputs) = jax.lax.scan(back, last, (keys, frames), reverse=True)
    return jnp.concatenate([earlier, last[None]]), outputs


def log_backward(model: CompiledModel, x: Array, particles: Array, log_weights: Array, inputs: Any) -> tuple[Array, Array]:
    """Unnormalised log-probabilities (N,) that a state (d,) comes from each particle, and whether there is any."""
    log_transition = log_transitions_into(model, x, particles, inputs)
    joint = log_weights + nan_to_neg_inf(log_transition)
    return joint, jnp.any(joint > -jnp.inf)
