"""The groups of a result that ArviZ compares models and checks their predictions with.

``posterior_predictive``   data drawn given each draw of the posterior, by site, (chain, draw, frame, ...)
``log_likelihood``         log p(z | x) of each datum given each draw, (chain, draw, frame, ...); NaN where it is missing

For a smoothed result, whose draws condition on all data, leave-one-out cross-validation (``arviz.loo``) has its usual meaning:
it leaves out one datum of all. Draws of a filter's result condition on the data up to their own frame. So leaving a frame's
datum out predicts it from those before it. Both are only as good as the importance weights, whose quality ``arviz.loo``
reports.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import NDArray

from poseppl.checks import check_key
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_inputs import with_earlier_data
from poseppl.runs.contents import arrays_of, flat_draws, group_of
from poseppl.runs.frame_sequence import stacked_inputs
from poseppl.runs.model_fingerprint import check_same_model


def add_predictive(result: xr.DataTree, model: CompiledModel, rng_key: Array, inputs: Any = None) -> xr.DataTree:
    """Add ``posterior_predictive`` and ``log_likelihood`` to a result.

    Args:
        result: The result, with its data; not modified.
        model: The model that it is one of.
        rng_key: PRNG key.
        inputs: The filter's inputs.

    Returns:
        The result with both groups (a shallow copy).

    Raises:
        ValueError: The result is one of other coordinates or params, or an array of the inputs does not have T rows.
        InputError: The result holds no data, or the model has no data sites.
    """
    check_key(rng_key)
    check_same_model(result, model)
    if not model.observation_sites:
        raise InputError("the model has a heuristic likelihood alone, which predicts no data", expected="data sites")
    held = arrays_of(result, "observed_data")
    if not set(model.observation_sites) <= set(held):
        expected = f"the sites {list(model.observation_sites)}"
        raise InputError("the result does not contain the data", field="observed_data", expected=expected)
    observations = model.observe({name: held[name] for name in model.observation_sites})
    draws = flat_draws(result).transpose("frame", "chain", "draw", "state_dim").values
    frames, chains, length, dimension = draws.shape
    keys = jax.random.split(rng_key, frames)
    flat = draws.reshape(frames, chains * length, dimension)
    rows = stacked_inputs(with_earlier_data(model, observations, inputs), frames)
    data, terms = _of_frames(model, keys, flat, observations, rows)
    seen, groups = group_of(result, "observed_data"), {}
    for group, values in (("posterior_predictive", data), ("log_likelihood", terms)):
        parts = {name: _labelled(np.asarray(array), chains, seen[name]) for name, array in values.items()}
        groups[group] = xr.DataTree(xr.Dataset(parts))
    return result.assign(groups)


@partial(jit, static_argnums=0)
def _of_frames(
    model: CompiledModel, keys: Array, draws: Array, observations: Observation, inputs: Any
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Replicates, and log-likelihoods, (T, N, ...) by site, of draws (T, N, d)."""

    def of_frame(row: Any) -> Any:
        key, states, observation, frame = row
        data = jax.vmap(lambda key, x: model.sample_observation(key, x, frame))(jax.random.split(key, len(states)), states)
        return data, jax.vmap(lambda x: model.log_data(x, observation, frame))(states)

    data, terms = jax.lax.map(of_frame, (keys, draws, observations, inputs))
    return data, terms


def _labelled(values: NDArray[Any], chains: int, data: xr.DataArray) -> xr.DataArray:
    """(frame, chain times draw, ...) as (chain, draw, frame, ...), with the names that the data (frame, ...) have."""
    moved = np.moveaxis(values, 0, 1)
    array = moved.reshape(chains, -1, *moved.shape[1:])
    dims = data.dims[: array.ndim - 2]
    coords: dict[Any, Any] = {dim: data.coords[dim] for dim in dims if dim in data.coords}
    coords |= {"chain": np.arange(chains), "draw": np.arange(array.shape[1])}
    return xr.DataArray(array, coords, ("chain", "draw", *dims))
