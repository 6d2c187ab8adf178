"""A filter run over all frames inside jit, for the algorithms that call one again and again."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
from jax import Array

from poseppl.filters.base import Filter
from poseppl.filters.scan import scan_filter
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers.base import History, collect_history


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
    if built.is_optimizer:
        raise ValueError("The filter seeks a mode, and has no evidence to judge params by. Use a particle or a Kalman filter.")
    return built


def filter_history(filter: Filter, rng_key: Array, observations: Observation, inputs: Any) -> History:
    """Run a filter, and keep the history that a smoother needs."""
    history: History = scan_filter(filter, rng_key, observations, inputs, collect=collect_history).outputs
    return history


def filter_evidence(filter: Filter, rng_key: Array, observations: Observation, inputs: Any) -> Array:
    """Log-evidence of all frames as a filter estimates it, a scalar; -inf when it cannot."""
    return nan_to_neg_inf(jnp.sum(scan_filter(filter, rng_key, observations, inputs).outputs.log_evidence))
