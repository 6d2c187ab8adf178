"""Forecasts: states and data beyond the frames of a result, under inputs that are or might have been.

Each draw of the posterior at the last frame T goes on by itself, x_(T+h) ~ p(x | x_(T+h-1)), and draws its data z_(T+h) ~
p(z | x_(T+h)). So the draws of frame T + h are ones of p(x_(T+h), z_(T+h) | z_(1:T)), with the uncertainty of the present state
and of the future alike.

    ahead = forecast(result, model, 20, rng_key, inputs=inputs_of_the_20_frames)
    ahead["predictions/height"].quantile([0.05, 0.95], ("chain", "draw"))

Other inputs from an earlier frame on tell what would have come of them: ``forecast(..., start=100, inputs=others)``. Against
the data that came, :func:`poseppl.diagnostics.forecasts.score_forecast` counts errors and coverage.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import NDArray

from poseppl.checks import check_at_least, check_key
from poseppl.compilation import jit
from poseppl.errors import InputError
from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_data import EarlierDataModel, WithEarlier
from poseppl.program.earlier_inputs import at_frame, following, window_after
from poseppl.program.large_integers import check_exact
from poseppl.runs.contents import HISTORY, arrays_of, check_coordinates, flat_draws, frame_numbers, group_of, names_of_result
from poseppl.runs.frame_sequence import stacked_inputs
from poseppl.runs.labels import coordinates, labelled
from poseppl.runs.results import encoded, provenance

_START = 2**31 - 1
"""Number that the key of the draws to start from is folded with, beside those of frames."""


def forecast(
    result: xr.DataTree,
    model: CompiledModel,
    horizon: int,
    rng_key: Array,
    inputs: Any = None,
    *,
    start: int | None = None,
    num_draws: int | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.DataTree:
    """Draw states and data of the frames after a result's last one.

    Args:
        result: The result of :func:`poseppl.infer`, or, from its last frame on, of :func:`poseppl.smooth`.
        model: The model that the result is one of; or another one of the same sites, to ask what it would have expected.
        horizon: How many frames H, at least 1.
        rng_key: PRNG key; the same key gives the same forecast.
        inputs: Inputs of the new frames with a leading H, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None
            where the model takes none.
        start: Number of the frame that the forecast starts after; the last one if None.
        num_draws: Draws: of all the filter's particles where the result keeps them, else of each chain, evenly chosen or
            repeated; as many as the result holds if None.
        attrs: Provenance: anything that JSON can hold; that of the result is kept.

    Returns:
        Groups ``forecast``, the state's sites and the model's extras, and ``predictions``, the data, as ArviZ calls them; each
        (chain, draw, frame, ...). Frame numbers go on at the distance of the last two.

    Raises:
        ValueError: The result is one of other coordinates, or an array of the inputs does not have H rows.
        PosepplError: An integer of the state reaches what float32 does not hold.
        InputError: `start` is no frame of the result, or is not its last one and the result is smoothed.
    """
    check_at_least(1, horizon=horizon)
    check_key(rng_key)
    check_coordinates(result, model)
    numbers = frame_numbers(result)
    last = _position(result, numbers, start)
    if num_draws is not None:
        check_at_least(1, num_draws=num_draws)
    draws = _draws(result, num_draws, jax.random.fold_in(rng_key, _START))[:, :, last]
    keys = jax.random.split(rng_key, horizon)
    rows = stacked_inputs(inputs, horizon)
    before = _before(result, model, last, None, tree_index(rows, 0))
    sites, data, largest = _go_on(model, keys, draws.reshape(-1, draws.shape[-1]), rows, before)
    check_exact(model.sites, largest)
    step = int(numbers[last] - numbers[last - 1]) if last else 1
    frames = numbers[last] + step * np.arange(1, horizon + 1)
    names = names_of_result(result)
    known = coordinates(names, (*draws.shape[:2], horizon), frames)
    groups = {"forecast": _by_chain(sites, draws.shape[0])}
    if data:
        groups["predictions"] = _by_chain(data, draws.shape[0])
    leading = ("chain", "draw", "frame")
    tree = xr.DataTree.from_dict({name: labelled(group, leading, known, names.dims) for name, group in groups.items()})
    tree.attrs = dict(result.attrs) | encoded({"forecast from frame": int(numbers[last]), **(attrs or {})})
    return tree


def hindcast(
    result: xr.DataTree, model: CompiledModel, horizon: int, rng_key: Array, inputs: Any = None, *, num_draws: int = 200
) -> xr.Dataset:
    """Forecast from every frame of a filter's result that has H frames after it, under the inputs that were.

    Args:
        result: The result of a filter.
        model: The model that it is one of.
        horizon: H, at least 1, and less than the result's frames.
        rng_key: PRNG key.
        inputs: The filter's inputs.
        num_draws: Draws, as :func:`forecast` takes them.

    Returns:
        Predicted data by site, (chain, draw, start, lead, ...); ``start`` is the number of the frame that a forecast starts
        after, ``lead`` 1, ..., H counts the frames since.

    Raises:
        ValueError: The result is one of other coordinates, or an array of the inputs does not have T rows.
        InputError: The result is smoothed, or has too few frames.
    """
    check_at_least(1, horizon=horizon, num_draws=num_draws)
    check_key(rng_key)
    check_coordinates(result, model)
    numbers = frame_numbers(result)
    if "smoother" in provenance(result):
        raise InputError("the result is smoothed: its draws know the data after them", expected="the filter's result")
    if horizon >= len(numbers):
        raise InputError(f"{horizon}", field="horizon", expected=f"less than the result's {len(numbers)} frames")
    starts = len(numbers) - horizon
    chosen = np.moveaxis(_draws(result, num_draws, jax.random.fold_in(rng_key, _START)), 2, 0)[:starts]
    ahead = np.arange(starts)[:, None] + np.arange(1, horizon + 1)
    rows = stacked_inputs(inputs, len(numbers))
    windows = tree_index(rows, ahead)
    given = [_before(result, model, start, tree_index(rows, start), None) for start in range(starts)]
    before = jax.tree.map(lambda *leaves: jnp.stack(leaves), *given)
    keys = jax.random.split(rng_key, (starts, horizon))
    data = _from_all(model, keys, chosen.reshape(starts, -1, chosen.shape[-1]), windows, before)
    variables = {}
    for name, values in data.items():
        array = np.moveaxis(np.asarray(values), 2, 0).reshape(chosen.shape[1], num_draws, starts, horizon, *values.shape[3:])
        variables[name] = (("chain", "draw", "start", "lead", *(f"{name}_dim_{i}" for i in range(array.ndim - 4))), array)
    return xr.Dataset(variables, {"start": numbers[:starts], "lead": np.arange(1, horizon + 1)})


def _draws(result: xr.DataTree, number: int | None, rng_key: Array) -> NDArray[Any]:
    """Draws (chain, number, frame, d): of all particles by weight where the result keeps them, else some of its draws."""
    kept = group_of(result, HISTORY)
    if number is None or "state" not in kept:
        draws: NDArray[Any] = flat_draws(result).transpose("chain", "draw", "frame", "state_dim").values
        return draws if number is None else draws[:, np.arange(number) * draws.shape[1] // number]
    particles, log_weights = kept["state"].values, kept["log_weight"].values
    keys = jax.random.split(rng_key, len(particles))
    chosen = np.asarray(jax.vmap(lambda key, weights: systematic(key, weights, number))(keys, log_weights))
    return np.swapaxes(np.take_along_axis(particles, chosen[..., None], 1), 0, 1)[None]


@partial(jit, static_argnums=0)
def _from_all(model: CompiledModel, keys: Array, draws: Array, inputs: Any, before: Any) -> dict[str, Array]:
    """Data (starts, H, N, ...) after states (starts, N, d)."""
    found: dict[str, Array] = jax.lax.map(lambda row: _go_on(model, *row)[1], (keys, draws, inputs, before))
    return found


def _before(result: xr.DataTree, model: CompiledModel, frame: int, inputs: Any, later: Any) -> WithEarlier | None:
    """Earlier data that the frame after one of a result needs; None for models that read no earlier data.

    Args:
        result: The result.
        model: Its model.
        frame: Index of the frame.
        inputs: Inputs of that frame; None if they are unknown.
        later: Those of the next one, which stand in where the frame's own are not read.

    Raises:
        InputError: A datum is missing that a later frame reads, and is not imputed, or not without the frame's inputs.
    """
    if not isinstance(model, EarlierDataModel):
        return None
    held = arrays_of(result, "observed_data")
    window = window_after(model, model.observe({name: held[name] for name in model.observation_sites}), frame)
    missing = [name for name, seen in window.seen.items() if not np.all(seen[-1])]
    if missing and inputs is None and jax.tree.leaves(later):
        raise InputError(
            f"the data of frame {frame_numbers(result)[frame]} are missing, and depend on its inputs, which a forecast lacks",
            field=missing[0],
            expected="a start at a frame with data (start=), and the inputs from there on",
        )
    before = WithEarlier(None, window, (later if inputs is None else inputs) if model.impute else None)
    at_frame(model, None, before)  # which refuses what is missing and not imputed
    return before


def _position(result: xr.DataTree, numbers: NDArray[np.int64], start: int | None) -> int:
    """The index of the frame to start after."""
    if start is None:
        return len(numbers) - 1
    found = np.flatnonzero(numbers == start)
    if not len(found):
        expected = f"one of {numbers[0]} to {numbers[-1]}"
        raise InputError(f"the result has no frame {start}", field="start", expected=expected)
    if "smoother" in provenance(result) and found[0] < len(numbers) - 1:
        raise InputError(
            f"the result is smoothed: its draws at frame {start} know the data after it",
            field="start",
            expected="the filter's result, or the last frame",
        )
    return int(found[0])


@partial(jit, static_argnums=0)
def _go_on(
    model: CompiledModel, keys: Array, draws: Array, inputs: Any, before: WithEarlier | None
) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Sites with extras, and data, each (H, N, ...), after states (N, d), and the largest sizes of these (N, d)."""
    number = draws.shape[0]

    def advance(carried: Any, row: Any) -> Any:
        (states, before, largest), (key, frame) = carried, row
        key_move, key_data = jax.random.split(key)

        def of_draw(key_move: Array, key_data: Array, x: Array, before: Any) -> Any:
            given = at_frame(model, frame, before)
            x = model.sample_transition(key_move, x, given)
            values = model.sample_observation(key_data, x, given)
            seen = {name: jnp.ones(value.shape, bool) for name, value in values.items()}
            sites = {**model.extras(x, given), **model.to_sites(x, given)}
            return x, following(model, given, Observation(values, seen)), sites, values

        keys = jax.random.split(key_move, number), jax.random.split(key_data, number)
        states, before, sites, data = jax.vmap(of_draw)(keys[0], keys[1], states, before)
        return (states, before, jnp.maximum(largest, jnp.abs(states))), (sites, data)

    of_draws = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (number, *jnp.shape(leaf))), before)
    (_, _, largest), (sites, data) = jax.lax.scan(advance, (draws, of_draws, jnp.abs(draws)), (keys, inputs))
    return sites, data, largest


def _by_chain(values: Mapping[str, Array], chains: int) -> dict[str, NDArray[Any]]:
    """(frame, chain times draw, ...) to (chain, draw, frame, ...)."""
    moved = {name: np.moveaxis(np.asarray(value), 0, 1) for name, value in values.items()}
    return {name: value.reshape(chains, -1, *value.shape[1:]) for name, value in moved.items()}
