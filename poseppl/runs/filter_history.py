"""Record of a filter for smoothers and forecasts: the weighted particles of each frame, or its Gaussian.

A result keeps a few hundred draws of each frame. They were resampled frame by frame, so no draw descends from one of the frame
before. A smoother that looks for such a pair finds none where the transition has no noise. So a result also keeps

* of weighted particles all of them, with their weights, and their ancestors where the filter has a genealogy;
* of a Gaussian filter mean and covariance;
* of Markov chains nothing, as their draws are the posterior.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array

from poseppl.filters.base import Filter, FilterInfo, FilterState
from poseppl.gaussians.gaussian import Gaussian, RootGaussian
from poseppl.particles.weights import normalise

MIB = 2**20
HISTORY_MIB = 256.0
"""Room for the history of a run, MiB, unless another one is asked for."""
HISTORY_AXES = {
    "state": ("frame", "particle", "state_dim"),
    **dict.fromkeys(("log_weight", "ancestor"), ("frame", "particle")),
    "mean": ("frame", "state_dim"),
    "covariance": ("frame", "state_dim", "other_state_dim"),
}
"""Dimensions of its variables in a result."""


class ParticleHistory(NamedTuple):
    """Weighted particles (T, N, d), normalised log-weights (T, N), and ancestors (T, N), or (T, 0) without a genealogy."""

    particles: Array
    log_weights: Array
    ancestors: Array


def history_of_frame(filter: Filter, state: FilterState, info: FilterInfo) -> ParticleHistory | Gaussian | None:
    """Record of one frame; None for a filter of chains."""
    if state.log_weights.ndim != 1:
        return None
    gaussian = getattr(state, "posterior", None)
    if isinstance(gaussian, Gaussian | RootGaussian):
        return Gaussian(gaussian.mean, gaussian.covariance)
    ancestors = with_genealogy_alone(filter, info).ancestors
    return ParticleHistory(state.particles, normalise(state.log_weights).log_weights, jnp.asarray(ancestors, jnp.int32))


def with_genealogy_alone(filter: Filter, info: FilterInfo) -> FilterInfo:
    """A diagnosis whose ancestors are none where a filter's particles descend from no single one."""
    return info if filter.genealogy else info._replace(ancestors=jnp.zeros(0, jnp.int32))


def bytes_of_frame(filter: Filter, state: Any) -> int:
    """Bytes of :func:`history_of_frame`, from a state or its shapes."""
    if state.log_weights.ndim != 1:
        return 0
    gaussian = getattr(state, "joint", None)
    if gaussian is not None:
        return int((gaussian.mean.shape[0] + 1) * gaussian.mean.size * gaussian.mean.dtype.itemsize)
    number, dimension = state.particles.shape
    return int(number * ((dimension + 1) * state.particles.dtype.itemsize + 4 * filter.genealogy))


def history_variables(history: ParticleHistory | Gaussian | None) -> dict[str, Array]:
    """A history as the variables of a result's group, with a leading T."""
    if isinstance(history, Gaussian):
        return {"mean": history.mean, "covariance": history.covariance}
    if history is None:
        return {}
    variables = {"state": history.particles, "log_weight": history.log_weights}
    return variables | ({"ancestor": history.ancestors} if history.ancestors.shape[1] else {})


def no_room(needed: float, room: float) -> str:
    """Say that a history, which needs so many MiB, is not kept."""
    return (
        f"the filter's history needs {needed:,.0f} MiB, but its limit is {room:,g}: it is not kept, and smoothers start "
        f"from the draws of the result (give more room with history_mib={math.ceil(needed)}, or run fewer particles)"
    )
