"""Filters to turn to where particles miss the posterior: those that take the model, found from its programs.

The order is that of trials on models of the kind that people bring (docs/choosing.md). Programs are traced, and
nothing is computed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from poseppl.filters.base import Filter
from poseppl.filters.hidden_markov import hidden_markov_filter
from poseppl.filters.rao_blackwellised import rao_blackwellised_filter
from poseppl.program import CompiledModel
from poseppl.program.memoized_builder import memoized_builder


@memoized_builder
def compatible_filters(model: CompiledModel) -> tuple[str, ...]:
    """Names of filters for a model, the best first, as the command line has them; none where only particles will do.

    Args:
        model: The compiled model.
    """
    finite = model.finite_coordinates
    if all(finite):
        return ("hidden-markov",) if takes(model, hidden_markov_filter) else ()
    if any(finite):
        return ("rao-blackwellised",) if takes(model, rao_blackwellised_filter) else ()
    x, inputs = jnp.zeros(model.dimension), model.input_shapes
    if _traced(model.initial_moments, inputs) and _traced(model.transition_moments, x, inputs):
        return "assumed-density", *(("kalman",) if _traced(model.observation_moments, x, inputs) else ())
    return ("tempered",)


def takes(model: CompiledModel, builder: Callable[[CompiledModel], Filter]) -> bool:
    """Whether a filter takes a model: it is built, and its first and its later frames are traced."""
    key = jax.eval_shape(lambda: jax.random.key(0))
    frame = key, model.unobserved(), model.input_shapes
    try:
        filter = builder(model)
        state = (
            jax.eval_shape(filter.init, *frame)[0]
            if filter.initial_state is None
            else jax.eval_shape(filter.initial_state, *frame[1:])
        )
        jax.eval_shape(filter.step, key, state, *frame[1:])
    except ValueError:
        return False
    return True


def _traced(function: Callable[..., Any], *arguments: Any) -> bool:
    try:
        jax.eval_shape(function, *arguments)
    except ValueError:
        return False
    return True
