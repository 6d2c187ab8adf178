"""Many series of one model in one call: filters over (S, T) data, compiled once, vectorised over the series.

    whole = infer_batch(model, {"height": heights}, particle_filter(model, 500), rng_key)      # heights (S, T)
    whole["summary/level_mean"]                                                                # (series, frame)
    one = one_series(whole, 17)                                                                # a result like any other

Series of unequal length are given as a list of dicts of arrays, or padded with NaN, with their `lengths`. Series i has the
key ``jax.random.fold_in(rng_key, i)``, and is the run that :func:`poseppl.infer` makes of it, within float rounding.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import ArrayLike, NDArray

from poseppl.checks import check_at_least, check_key
from poseppl.compilation import jit
from poseppl.errors import InputError, brief
from poseppl.files.store import Note
from poseppl.filters.base import Filter
from poseppl.filters.scan import scan_filter
from poseppl.particles.stacks import tree_index
from poseppl.program import CompiledModel, Observation
from poseppl.program.earlier_data import EarlierDataModel
from poseppl.program.earlier_inputs import check_seen, with_earlier_data
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.observation import number_array
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import FLAT, HISTORY
from poseppl.runs.filter_history import (
    HISTORY_AXES,
    HISTORY_MIB,
    MIB,
    bytes_of_frame,
    history_variables,
    no_room,
)
from poseppl.runs.frame_sequence import Constant
from poseppl.runs.gaussian_draws import key_data
from poseppl.runs.infer import filter_of
from poseppl.runs.labels import Names, checked, coordinates, labelled, labelled_summary
from poseppl.runs.model_fingerprint import fingerprint_of
from poseppl.runs.outcome import angles_of
from poseppl.runs.results import VERSION, encoded
from poseppl.runs.run import Collect, Progress
from poseppl.runs.step_output import StepOutput, collect_kept, with_draws

_LOGGER = logging.getLogger("poseppl")
_DRAWS = 20
"""Draws kept of a frame of each series, unless asked otherwise."""


def infer_batch(
    model: CompiledModel,
    data: Mapping[str, ArrayLike] | Sequence[Mapping[str, ArrayLike]],
    filter: Filter | Callable[[CompiledModel], Filter],
    rng_key: Array,
    inputs: Any = None,
    *,
    lengths: ArrayLike | None = None,
    chunk: int = 100,
    collect: Collect | None = None,
    names: Sequence[Any] | None = None,
    attrs: Mapping[str, Any] | None = None,
    history_mib: float = HISTORY_MIB,
    progress: Progress | None = None,
) -> xr.DataTree:
    """Filter many series.

    Args:
        model: The compiled model.
        data: Arrays (S, T, ...) by the name of their site, NaN where nothing was seen; or a list of S dicts of
            arrays (T_s, ...).
        filter: A filter of the model, or its builder.
        rng_key: PRNG key; series i has ``jax.random.fold_in(rng_key, i)``, whatever the chunk.
        inputs: Inputs (S, T, ...), what is the same for all wrapped in :class:`~poseppl.runs.run.Constant`; or a list of S,
            each with a leading T_s; None where the model takes none.
        lengths: Frames (S,) of each series, where `data` are arrays that are padded; T for all if None.
        chunk: Series at a time, at most, in as many equal parts as that takes; more take more memory.
        collect: Collector of each frame, from :func:`~poseppl.runs.collectors.collect_draws`; 20 draws and summaries if None.
        names: Names of the series (S,); 0, 1, ... if None.
        attrs: Provenance: anything that JSON can hold.
        history_mib: Room for what smoothers start from, of all series, MiB; as :func:`poseppl.infer` takes it.
        progress: Callback for the number of series that are done.

    Returns:
        A result with the dimension ``series`` in every group, NaN after the end of a series; ``sample_stats/num_frames`` has
        their lengths, ``sample_stats/log_evidence`` (series, frame) the evidence.

    Raises:
        ValueError: The model is not compiled, the filter is one of another model, or data or inputs do not fit.
        InputError: No series, or lengths or names that do not fit.
    """
    check_at_least(1, chunk=chunk)
    check_key(rng_key)
    built = filter_of(filter, model)
    stacked, ends = _stacked(data, lengths)
    observations = _observed(model, stacked)
    number, frames = next(iter(stacked.values())).shape[:2]
    called = list(range(number)) if names is None else list(names)
    if len(called) != number or len(set(called)) != number:
        raise InputError(f"{len(set(called))} different names", field="names", expected=f"{number}, one for each series")
    rows = _with_earlier_data(model, observations, _stacked_inputs(inputs, ends, frames), ends)
    keys = jax.vmap(jax.random.fold_in, (None, 0))(rng_key, jnp.arange(number))
    note = progress.note if progress else _LOGGER.warning
    keep = _has_room(built, (keys, observations, rows), number * frames, history_mib, note)
    collect = collect_draws(model, max_draws=_DRAWS) if collect is None else collect
    series = _series_program(built, collect, keep)
    parts = []
    size = -(-number // -(-number // chunk))
    for start in range(0, number, size):
        index = np.minimum(np.arange(start, start + size), number - 1)
        kept = series(keys[index], tree_index(observations, index), tree_index(rows, index))
        parts.append(tree_index(jax.tree.map(np.asarray, kept), slice(number - start)))
        if progress:
            progress.advance(min(size, number - start))
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)
    whole = with_draws(collect, whole, key_data(keys))
    failures = list(_failures(whole, ends, called))
    for text in failures:
        note(text)
    warnings = [*model.rounding_notes(observations).values(), *failures]
    attributes = {
        **built.provenance,
        **(attrs or {}),
        **angles_of(model),
        **fingerprint_of(model),
        **({"warnings": warnings} if warnings else {}),
    }
    return _result(whole, model, stacked, ends, called, attributes)


def one_series(batch: xr.DataTree, name: Any) -> xr.DataTree:
    """The result of one series of a batch, by its name, as :func:`poseppl.infer` gives it.

    Raises:
        InputError: The batch has no such series.
    """
    known = batch["sample_stats"].dataset["num_frames"]
    if name not in known["series"].values:
        raise InputError(f"the batch has no series {brief(name)}", expected=f"one of its {known.size}")
    length = int(known.sel(series=name))
    one: xr.DataTree = batch.sel(series=name).isel(frame=slice(length))
    return one


def _has_room(filter: Filter, series: Any, num_frames: int, room: float, note: Note) -> bool:
    """Whether the history of all frames of all series is kept."""
    key, observations, inputs = tree_index(series, 0)
    state, _ = jax.eval_shape(filter.init, key, *tree_index((observations, inputs), 0))
    needed = bytes_of_frame(filter, state) * num_frames / MIB
    if needed > room > 0:
        note(no_room(needed, room))
    return 0 < needed <= room


@memoized_builder
def _series_program(filter: Filter, collect: Collect, keep: bool) -> Any:
    """`(keys, observations, inputs) -> StepOutput`, each (S, T, ...), of a chunk of series."""

    def of_series(key: Array, observations: Observation, inputs: Any) -> StepOutput:
        kept: StepOutput = scan_filter(
            filter, key, observations, inputs, collect=collect_kept(filter, collect, keep, lean=True)
        ).outputs
        return kept._replace(unique_ancestors=None)  # which a batch does not report, and need not compute

    return jit(jax.vmap(of_series))


def _stacked(data: Any, lengths: ArrayLike | None) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Data (S, T, ...) by site, padded with NaN, and the lengths (S,) of the series."""
    if isinstance(data, Sequence):
        if lengths is not None:
            raise InputError("given beside a list of series", field="lengths", expected="none, or data in padded arrays")
        return _stacked_series(data)
    if not hasattr(data, "keys"):
        expected = "a dict of arrays (series, frame, ...) by site, or a list of series"
        raise InputError(f"a {type(data).__name__}", field="data", expected=expected)
    arrays = {str(name): number_array(str(name), data[name]) for name in data}
    shapes = {values.shape[:2] for values in arrays.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
        expected = "arrays (series, frame, ...), of one number of series and of frames, or a list of series"
        raise InputError(f"data of shapes {[values.shape for values in arrays.values()]}", field="data", expected=expected)
    number, frames = next(iter(shapes))
    ends = np.full(number, frames) if lengths is None else np.asarray(lengths, int)
    if ends.shape != (number,) or ends.min() < 1 or ends.max() > frames:
        raise InputError(f"lengths of shape {ends.shape}", field="lengths", expected=f"{number} numbers from 1 to {frames}")
    return {name: _blanked(values, ends) for name, values in arrays.items()}, ends


def _stacked_series(data: Sequence[Any]) -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """The same from a list of series, each of which has all sites, of one number of frames."""
    if not len(data):
        raise InputError("there is no series", field="data", expected="at least one")
    series = [_series(index, each) for index, each in enumerate(data)]
    wanted = {name: values.shape[1:] for name, values in series[0].items()}
    for index, each in enumerate(series):
        given = {name: values.shape[1:] for name, values in each.items()}
        if given != wanted:
            expected = f"{wanted}, as series 0 has, in each frame"
            raise InputError(f"series {index} has sites of the shapes {given}", field="data", expected=expected)
    ends = np.array([len(next(iter(each.values()))) for each in series])
    return {name: _padded([each[name] for each in series], ends.max()) for name in wanted}, ends


def _series(index: int, data: Any) -> dict[str, NDArray[Any]]:
    """The arrays (T, ...) of one series by site."""
    if not hasattr(data, "keys"):
        raise InputError(f"series {index} is a {type(data).__name__}", field="data", expected="a dict of arrays by site")
    arrays = {str(name): number_array(str(name), data[name]).astype(float) for name in data}
    frames = {name: len(values) if values.ndim else 0 for name, values in arrays.items()}
    if len(set(frames.values())) != 1 or 0 in frames.values():
        expected = "one number of frames for all sites, at least 1 (NaN where nothing was seen)"
        raise InputError(f"series {index} has the frames {frames}", field="data", expected=expected)
    return arrays


def _padded(series: list[NDArray[Any]], frames: int) -> NDArray[Any]:
    fill = [np.full((frames - len(each), *each.shape[1:]), np.nan) for each in series]
    return np.stack([np.concatenate(pair) for pair in zip(series, fill, strict=True)])


def _blanked(values: NDArray[Any], ends: NDArray[np.int64]) -> NDArray[Any]:
    """NaN after the end of each series (S, T, ...); integers stay as they are where no series ends early."""
    beyond = np.arange(values.shape[1]) >= ends[:, None]
    if not beyond.any():
        return values
    return np.where(beyond.reshape(*beyond.shape, *(1,) * (values.ndim - 2)), np.nan, values)


def _observed(model: CompiledModel, data: Mapping[str, NDArray[Any]]) -> Observation:
    """Data (S, T, ...) with their masks."""
    flat = model.observe({name: values.reshape(-1, *values.shape[2:]) for name, values in data.items()})
    shape = next(iter(data.values())).shape[:2]
    whole: Observation = jax.tree.map(lambda leaf: leaf.reshape(*shape, *leaf.shape[1:]), flat)
    return whole


def _stacked_inputs(inputs: Any, ends: NDArray[np.int64], frames: int) -> Any:
    """Inputs (S, T, ...): lists padded with their last rows, what is constant repeated."""
    number = len(ends)
    if isinstance(inputs, list):
        if len(inputs) != number:
            raise InputError(f"inputs of {len(inputs)} series", field="inputs", expected=f"those of {number}")
        for index, (one, end) in enumerate(zip(inputs, ends, strict=True)):
            _check_rows(index, one, {int(end), frames})
        padded = [tree_index(jax.tree.map(np.asarray, one), _until_end(one, frames)) for one in inputs]
        return jax.tree.map(lambda *leaves: jnp.stack(leaves), *padded)

    def stack(leaf: Any) -> Any:
        if isinstance(leaf, Constant):
            return jax.tree.map(lambda value: jnp.broadcast_to(value, (number, frames, *np.shape(value))), leaf.value)
        if np.shape(leaf)[:2] != (number, frames):
            expected = f"({number}, {frames}, ...), or a Constant for values that are the same in all frames"
            raise InputError(f"an array of shape {np.shape(leaf)}", field="inputs", expected=expected)
        return jnp.asarray(leaf)

    return jax.tree.map(stack, inputs, is_leaf=lambda node: isinstance(node, Constant))


def _with_earlier_data(model: CompiledModel, observations: Observation, rows: Any, ends: NDArray[np.int64]) -> Any:
    """Inputs (S, T, ...) with the data before each frame, for a model that reads them."""
    if not isinstance(model, EarlierDataModel):
        return rows
    for index, end in enumerate(ends):
        check_seen(model, tree_index(observations, index), int(end))
    return jax.vmap(lambda data, inputs: with_earlier_data(model, data, inputs))(observations, rows)


def _check_rows(index: int, inputs: Any, allowed: set[int]) -> None:
    """Refuse inputs of a series that has another number of frames."""
    leaves = jax.tree.leaves(inputs, is_leaf=lambda node: isinstance(node, Constant))
    if not leaves:
        expected = "arrays of its frames, or inputs=None where the model takes none"
        raise InputError(f"series {index} has none", field="inputs", expected=expected)
    for leaf in leaves:
        if isinstance(leaf, Constant) or np.ndim(leaf) == 0 or len(leaf) not in allowed:
            given = "a Constant" if isinstance(leaf, Constant) else f"an array of shape {np.shape(leaf)}"
            expected = f"{min(allowed)} rows, one for each frame of the series; in a list, repeat constant values"
            raise InputError(f"series {index} has {given}", field="inputs", expected=expected)


def _until_end(inputs: Any, frames: int) -> NDArray[np.int64]:
    """Rows of inputs for so many frames, the last one again and again after their end."""
    return np.minimum(np.arange(frames), len(jax.tree.leaves(inputs)[0]) - 1)


def _failures(kept: Any, ends: NDArray[np.int64], names: list[Any]) -> Iterator[str]:
    """Sentences on the series in which data were impossible, or states are not finite."""
    info, finite = kept.info, kept.finite
    within = np.arange(finite.shape[1]) < ends[:, None]
    for what, frames in (
        ("the data are impossible under the model; such frames are predicted, not updated", info.failed & finite),
        ("the filter's state is not finite or has integers beyond 2^24, and nothing from there on can be trusted", ~finite),
    ):
        found = np.argwhere(frames & within)
        if found.size:
            count, (series, frame) = len(np.unique(found[:, 0])), found[0]
            yield f"{count} of {len(names)} series, such as {brief(names[series])} at frame {frame}: {what}"


def _result(
    kept: Any, model: CompiledModel, data: Mapping[str, NDArray[Any]], ends: NDArray[np.int64], names: list[Any], attrs: Any
) -> xr.DataTree:
    outputs, info, finite = kept.outputs, kept.info, kept.finite
    chains, draws = outputs.state.shape[2:4]
    frames = finite.shape[1]
    beyond = np.arange(frames) >= ends[:, None]

    def blank(values: NDArray[Any]) -> NDArray[Any]:
        if values.dtype.kind != "f" or not beyond.any():
            return values
        return np.where(beyond.reshape(*beyond.shape, *(1,) * (values.ndim - 2)), values.dtype.type(np.nan), values)

    def by_chain(values: NDArray[Any]) -> NDArray[Any]:
        """(series, frame, chain, draw, ...) to (chain, draw, series, frame, ...)."""
        return np.moveaxis(blank(values), (2, 3), (0, 1))

    known = coordinates(Names(model.coordinate_names, values=model.finite_values), (chains, draws, frames))
    known = known.assign(series=np.asarray(names))
    leading, of_series = ("chain", "draw", "series", "frame"), ("series", "frame")
    stats = {name: blank(values) for name, values in info._asdict().items() if name != "ancestors"}
    stats["acceptance_rate"] = stats.pop("acceptance")
    stats["failed"] = stats["failed"] | ~finite
    posterior = {name: by_chain(values) for name, values in {**outputs.extras, **outputs.sites}.items()}
    groups = {
        "posterior": labelled(posterior, leading, known),
        FLAT: labelled({"state": by_chain(outputs.state)}, leading, known),
        "sample_stats": labelled(stats, of_series, known).assign(num_frames=("series", ends)),
        "summary": labelled_summary({name: blank(values) for name, values in outputs.summary.items()}, of_series, known),
        "observed_data": labelled(data, of_series, known),
    }
    variables = history_variables(kept.history)
    if variables:
        groups[HISTORY] = checked(
            {name: (("series", *HISTORY_AXES[name]), np.asarray(each)) for name, each in variables.items()}, known
        )
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {"poseppl_result": VERSION, **encoded(attrs)}
    return tree
