"""Inputs with the data before each frame, for models that read them (:mod:`poseppl.program.earlier_data`).

Every driver calls these functions. The inputs of any other model are returned as they were given.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.errors import InputError
from poseppl.program.compiled import CompiledModel
from poseppl.program.earlier_data import EarlierDataModel, Window, WithEarlier
from poseppl.program.frame_inputs import Constant, check_input_rows
from poseppl.program.observation import Observation, check_is_observation


def at_frame(model: CompiledModel | None, inputs: Any, before: WithEarlier | None) -> Any:
    """Inputs of one frame with the data before it; `before` is what :func:`following` made of the frame before, if any.

    Raises:
        InputError: A datum before it is missing, and is not imputed.
    """
    if not isinstance(model, EarlierDataModel):
        return inputs
    window = model.empty_window if before is None else before.window
    if not model.impute:
        _refuse_missing(window.seen, "of the frames before it")
    earlier = (inputs if before is None else before.inputs_before) if model.impute else None
    return WithEarlier(inputs, window, earlier)


def following(model: CompiledModel | None, inputs: Any, data: Observation) -> WithEarlier | None:
    """Take from a frame what the next frame needs: its data, and its inputs, which have the data before it."""
    if not isinstance(model, EarlierDataModel):
        return None
    return WithEarlier(None, pushed(inputs.window, data), inputs.inputs if model.impute else None)


def pushed(window: Window, data: Observation) -> Window:
    """A window moved on by a frame."""

    def push(old: Any, new: Any) -> Any:
        return jnp.concatenate([jnp.asarray(old)[1:], jnp.asarray(new)[None].astype(jnp.result_type(old))])

    names = list(window.values)
    return Window(
        {name: push(window.values[name], data.values[name]) for name in names},
        {name: push(window.seen[name], data.mask[name]) for name in names},
    )


def with_earlier_data(
    model: CompiledModel | None, observations: Observation, inputs: Any, before: WithEarlier | None = None
) -> Any:
    """Inputs of T frames with the data before each.

    Args:
        model: The model, or None.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.Constant`; or such as have their data.
        before: Result of :func:`following` for the frame before these; None at the first frame.

    Raises:
        InputError: A datum is missing that a later frame reads, and is not imputed.
        ValueError: An array of the inputs does not have T rows.
    """
    if not isinstance(model, EarlierDataModel) or isinstance(inputs, WithEarlier):
        return inputs
    check_is_observation(observations)
    check_seen(model, observations)
    data, start = _returning(model, observations), at_frame(model, None, before)
    numpy: Any = jnp if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(data)) else np

    def windows(first: Any, rows: Any) -> Any:
        whole = numpy.concatenate([numpy.asarray(first), numpy.asarray(rows).astype(first.dtype)])
        return numpy.stack([whole[lag : lag + len(rows)] for lag in range(len(first))], 1)

    rows = jax.tree.map(windows, start.window, data)
    check_input_rows(inputs, len(jax.tree.leaves(data)[0]))
    return WithEarlier(inputs, rows, _inputs_before(inputs, start.inputs_before) if model.impute else None)


def _inputs_before(inputs: Any, first: Any) -> Any:
    """Inputs of the frame before each; those of the first frame are read by none, if `first` is None."""

    def shifted(leaf: Any, row: Any) -> Any:
        if isinstance(leaf, Constant):
            return leaf
        numpy: Any = jnp if isinstance(leaf, Array) else np
        return numpy.concatenate([numpy.asarray(row)[None], numpy.asarray(leaf)[:-1]])

    if first is None:
        first = jax.tree.map(lambda leaf: leaf if _is_constant(leaf) else leaf[0], inputs, is_leaf=_is_constant)
    return jax.tree.map(shifted, inputs, first, is_leaf=_is_constant)


def _is_constant(leaf: Any) -> bool:
    return isinstance(leaf, Constant)


def window_after(model: EarlierDataModel, observations: Observation, frame: int) -> Window:
    """The last data up to a frame of a sequence."""

    def last(first: Any, rows: Any) -> Any:
        return np.concatenate([first, np.asarray(rows[: frame + 1]).astype(first.dtype)])[-len(first) :]

    window: Window = jax.tree.map(last, model.empty_window, _returning(model, observations))
    return window


def _returning(model: EarlierDataModel, observations: Observation) -> Window:
    """The data (T, ...) of the sites that are read later."""
    return Window(*({name: part[name] for name in model.before} for part in observations))


def check_seen(model: CompiledModel, observations: Observation, num_frames: int | None = None) -> None:
    """Refuse missing data that a later one of the first `num_frames` frames reads, and that are not imputed.

    Raises:
        InputError: There are such data; the message names site and frame.
    """
    if isinstance(model, EarlierDataModel) and not model.impute:
        stop = -1 if num_frames is None else num_frames - 1
        _refuse_missing({name: observations.mask[name][:stop] for name in model.before}, "of the sequence")


def _refuse_missing(seen: Mapping[str, Any], where: str) -> None:
    """Refuse masks (n, ...) by site of data that were not all seen; the likelihood of masks that are traced is NaN then."""
    for name, mask in seen.items():
        if isinstance(mask, jax.core.Tracer) or np.all(mask):
            continue
        frame = int(np.argmin(np.asarray(mask).reshape(len(mask), -1).all(1)))
        raise InputError(
            f"site {name!r} is missing at frame {frame} (counted from 0) {where}, and a later frame reads it",
            field="data",
            expected="data without gaps, or StateSpaceModel(..., impute=True), which makes a missing datum a state",
        )
