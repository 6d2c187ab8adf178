"""A filter run over all frames inside jit, for the algorithms that call one again and again."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.filters.base import Filter, Info
from poseppl.particles.stacks import prepend, split_first
from poseppl.particles.weights import without_nan
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.base import History, collect_history

Keep = Callable[[Any, Info], Any]


def filter_for(model: CompiledModel, build_filter: Any) -> Filter:
    """The filter of a model with its params; `build_filter` has to build it of the very model that it is given.

    Raises:
        ValueError: It is a filter already, builds one of another model, so that params would not count, or builds one that
            seeks a mode and has no evidence.
    """
    cure = "a function of the model, such as lambda model: particle_filter(model, 500), for params make another model of it"
    if not callable(build_filter):
        raise ValueError(f"The filter is a {type(build_filter).__name__}. Expected {cure}.")
    built: Filter = build_filter(model)
    if built.model not in (None, model):
        raise ValueError(f"The filter was built for another model, whose params are others. Expected {cure}.")
    if built.seeks_mode:
        raise ValueError("The filter seeks a mode, and has no evidence to judge params by. Use a particle or a Kalman filter.")
    return built


def scan_filter(filter: Filter, rng_key: Array, observations: Observation, inputs: Any, keep: Keep) -> Any:
    """Run a filter, and stack what `keep(state, info)` returns for each frame."""
    key_first, key_later = jax.random.split(rng_key)
    first, later = split_first((observations, inputs))
    state, info = filter.init(key_first, *first)
    num_later = jax.tree.leaves(observations)[0].shape[0] - 1

    def advance(state: Any, row: Any) -> tuple[Any, Any]:
        state, info = filter.step(jax.random.fold_in(key_later, row[0]), state, *row[1])
        return state, keep(state, info)

    kept = keep(state, info)
    _, rest = jax.lax.scan(advance, state, (jnp.arange(num_later), later))
    return prepend(kept, rest)


def filter_history(filter: Filter, rng_key: Array, observations: Observation, inputs: Any) -> History:
    """Run a filter, and keep the history that a smoother needs."""
    history: History = scan_filter(
        filter, rng_key, observations, inputs, lambda state, info: collect_history(rng_key, state, info, None)
    )
    return history


def filter_evidence(filter: Filter, rng_key: Array, observations: Observation, inputs: Any) -> Array:
    """Log-evidence of all frames as a filter estimates it, a scalar; -inf when it cannot."""
    increments = scan_filter(filter, rng_key, observations, inputs, lambda _, info: info.log_evidence)
    total = jnp.sum(increments)
    return without_nan(total)
