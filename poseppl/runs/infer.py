"""One call from a model and data to a result, and one from a result to its smoothing.

    result = infer(model, data, particle_filter(model, 1000), rng_key, inputs=inputs)
    smoothed = smooth(result, forward_backward_smoother(model), rng_key, inputs=inputs)

They assemble what stands in :mod:`poseppl.runs.run`, :mod:`~poseppl.runs.smoothing`, :mod:`~poseppl.runs.collectors` and
:mod:`~poseppl.runs.outcome`: whoever wants something else of each frame than draws, such as all particles, calls these.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any, Literal

import jax
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import ArrayLike

from poseppl.checks import check_key
from poseppl.errors import InputError
from poseppl.filters.base import Filter
from poseppl.program import CompiledModel, Observation, StateSpaceModel
from poseppl.program.clamped import ClampedModel
from poseppl.runs.checkpoint import Checkpoint
from poseppl.runs.collectors import collect_draws
from poseppl.runs.contents import FLAT, arrays_of
from poseppl.runs.filter_history import HISTORY_MIB
from poseppl.runs.fitted_params import with_checked_params
from poseppl.runs.frame_gaps import (
    Gaps,
    data_of_all_frames,
    inputs_of_all_frames,
    tell_filled,
    tell_gaps,
    truth_of_all_frames,
)
from poseppl.runs.model_fingerprint import check_same_model
from poseppl.runs.outcome import history_of_result, result_of_run, smoothed_result
from poseppl.runs.predictive import Predict
from poseppl.runs.results import provenance
from poseppl.runs.run import Collect, Progress, run_filter
from poseppl.runs.smoothing import run_smoother
from poseppl.smoothers.base import History, Smoother

_LOGGER = logging.getLogger("poseppl")
Data = Observation | Mapping[str, ArrayLike]
"""Arrays by the name of their observation site, with NaN where nothing was seen, or what `model.observe` made of them."""


def infer(
    model: CompiledModel,
    data: Data,
    filter: Filter | Callable[[CompiledModel], Filter],
    rng_key: Array,
    inputs: Any = None,
    *,
    params: Mapping[str, Any] | xr.DataTree | None = None,
    collect: Collect | None = None,
    predict: Predict | None = None,
    truth: ArrayLike | None = None,
    frames: ArrayLike | None = None,
    rate: float | None = None,
    attrs: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
    on_failure: Literal["continue", "stop"] = "continue",
    history_mib: float = HISTORY_MIB,
    fill_gaps: bool = False,
) -> xr.DataTree:
    """Filter a sequence.

    Args:
        model: The compiled model.
        data: Arrays with a leading T by the name of their site, NaN where nothing was seen; or an Observation.
        filter: A filter of the model, or its builder, such as ``kalman_filter`` or
            ``lambda model: particle_filter(model, 1000)``.
        rng_key: PRNG key; the same key gives the same result.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None where the model
            takes none.
        params: Params by name, or a fit (:func:`poseppl.fit`), for a builder; None where the model has its own, or none.
        collect: Collector of each frame, from :func:`~poseppl.runs.collectors.collect_draws`. None keeps 200 draws and
            summaries of all.
        predict: Predictive checks, of :func:`~poseppl.runs.predictive.predictive_checks`.
        truth: The true flat states (T, d), where known.
        frames: Frame numbers (T,), whole and increasing; 0, 1, ... if None.
        rate: Frames a second.
        attrs: Provenance: anything that JSON can hold.
        progress: Callback for the progress of the run.
        checkpoint: Folder to which the run is saved, and from which it is resumed.
        on_failure: Action at a frame with zero likelihood: "continue" from its prediction, or "stop".
        history_mib: Room for all particles of the filter, MiB, which smoothers start from; 0 keeps none. A run that needs more
            keeps none, and says so: smoothers then start from the draws.
        fill_gaps: Whether to insert frames without data where `frames` has gaps. Their inputs repeat the frame before
            (:func:`~poseppl.runs.frame_gaps.inputs_of_all_frames`). Without it one transition leads across, with a warning.

    Returns:
        The result, which ArviZ's functions take, before ArviZ 1 by :func:`poseppl.to_arviz`; see :mod:`poseppl.runs.results`.

    Raises:
        ValueError: The model is not compiled, the filter is one of another model, or data or inputs do not fit.
        InputError: The truth or the frame numbers do not fit, or a gap is too long to be filled.
        RunError: The run cannot go on.
    """
    _check_compiled(model)
    model = model if params is None else with_checked_params(model, params)
    built = filter_of(filter, model)
    observations = model.observe(data)
    check_labels(model, observations, truth, frames)
    gaps, note = Gaps([] if frames is None else frames), progress.note if progress else _LOGGER.warning
    warnings = () if fill_gaps else tell_gaps(gaps, note)
    if gaps and fill_gaps:
        observations, inputs, truth = fill_frames(model, gaps, observations, inputs, truth, note)
        frames = gaps.numbers
    run = run_filter(
        built,
        rng_key,
        observations,
        inputs,
        collect=collect_draws(model) if collect is None else collect,
        predict=predict,
        progress=progress,
        checkpoint=checkpoint,
        on_failure=on_failure,
        frame_numbers=None if frames is None else np.asarray(frames).tolist(),
        history_mib=history_mib,
    )
    warned = run._replace(warnings=(*warnings, *run.warnings))
    return result_of_run(warned, model, observations, truth=truth, frames=frames, rate=rate, attrs=attrs)


def smooth(
    filtered: xr.DataTree | History,
    smoother: Smoother,
    rng_key: Array,
    inputs: Any = None,
    *,
    data: Data | None = None,
    collect: Collect | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.DataTree:
    """Smooth what a filter left: every frame given all data, also those after it.

    Args:
        filtered: The result of :func:`infer`, with the filter's history; or a history itself, of
            ``run_filter(..., collect=collect_history)``.
        smoother: The smoother; it knows the model.
        rng_key: PRNG key; the same key gives the same result.
        inputs: The filter's inputs.
        data: The filter's data; those that the result holds if None. A history holds none.
        collect: Collector of each frame, from :func:`~poseppl.runs.collectors.collect_draws`; as in :func:`infer` if None.
        attrs: Provenance: anything that JSON can hold; that of the result is kept.

    Returns:
        The smoothed result, with truth, frames and rate of the filtered one.

    Raises:
        ValueError: The smoother does not know its model, the data of a history are missing, or the result is already smoothed.
            Also a result of another model or of other params, or data or inputs that do not fit.
        SmoothingError: The smoothed states are not finite.
    """
    check_key(rng_key)
    model = smoother.model
    if model is None:
        raise ValueError(
            "The smoother does not know its model. Use a builder of poseppl.smoothers, or Smoother(..., model=model)."
        )
    history, held = (filtered, {}) if isinstance(filtered, History) else _read(filtered, smoother, rng_key)
    given = held if data is None else data
    if not given:
        raise ValueError(
            "There are no data to smooth: a history contains none. Pass the filter's data, smooth(..., data=data)."
        )
    observations = model.observe(given)
    collect = collect_draws(model) if collect is None else collect
    run = run_smoother(smoother, rng_key, history, observations, inputs, collect=collect)
    if smoother.reweighs and isinstance(filtered, xr.DataTree) and set(model.finite_values) == set(model.sites):
        run = run._replace(method={**run.method, "closed form": provenance(filtered).get("closed form", False)})
    attributes = {"smoother": _name(smoother), **(attrs or {})}
    if isinstance(filtered, History):
        return result_of_run(run, model, observations, attrs=attributes)
    return smoothed_result(run, filtered, attributes, observations)


def _check_compiled(model: Any) -> None:
    if isinstance(model, StateSpaceModel):
        raise ValueError("The model is not compiled: infer(model.compile(inputs, params), ...), with the inputs of one frame.")
    if not isinstance(model, CompiledModel):
        raise ValueError(f"The model is a {type(model).__name__}. Expected what StateSpaceModel.compile returns.")


def check_labels(model: CompiledModel, observations: Observation, truth: ArrayLike | None, frames: ArrayLike | None) -> None:
    """Refuse a truth or frame numbers that are not those of T frames, before anything is computed."""
    number = max((len(leaf) for leaf in observations.values.values() if np.ndim(leaf)), default=None)
    if truth is not None and number is not None and np.shape(truth) != (number, model.dimension):
        expected = f"({number}, {model.dimension}), in each frame the coordinates {', '.join(model.coordinate_names)}"
        raise InputError(f"an array of shape {np.shape(truth)}", field="truth", expected=expected)
    if frames is None:
        return
    given, expected = np.asarray(frames), f"{number} whole numbers that increase" if number else "whole numbers that increase"
    if given.dtype.kind not in "fiu" or given.ndim != 1:
        raise InputError(f"{given.dtype} of shape {given.shape}", field="frames", expected=expected)
    if number not in (None, len(given)) or np.any(given != np.round(given)) or np.any(np.diff(given) <= 0):
        raise InputError(f"{len(given)} numbers from {given.min()} to {given.max()}", field="frames", expected=expected)


def fill_frames(
    model: CompiledModel,
    gaps: Gaps,
    observations: Observation,
    inputs: Any,
    truth: ArrayLike | None,
    note: Callable[[str], None],
) -> tuple[Observation, Any, ArrayLike | None]:
    """Data, inputs and truth of all frames; refuses clamped sites, whose values in a gap nobody knows."""
    if isinstance(model, ClampedModel):
        expected = "frames without gaps, with the clamped values of each"
        raise InputError("the clamped values of missing frames are unknown", field="fill_gaps", expected=expected)
    tell_filled(gaps, inputs, note)
    all_inputs = inputs_of_all_frames(inputs, gaps.frames)
    return data_of_all_frames(observations, gaps), all_inputs, truth_of_all_frames(truth, gaps)


def filter_of(filter: Any, model: CompiledModel) -> Filter:
    """The filter, or what its builder makes of the model.

    Raises:
        ValueError: It is neither, or one of another model, or the model is not compiled.
    """
    _check_compiled(model)
    built = filter if isinstance(filter, Filter) or not callable(filter) else filter(model)
    if not isinstance(built, Filter):
        raise ValueError(
            f"The filter is a {type(built).__name__}. Expected a filter, as particle_filter(model, 1000) builds it, or its "
            "builder, a function of the model."
        )
    if built.model not in (None, model):
        raise ValueError(
            "The filter was built for another model than the one given. Build it for this one, or give its builder: "
            "infer(model, data, lambda model: particle_filter(model, 1000), ...)."
        )
    return built


def _read(result: Any, smoother: Smoother, rng_key: Array) -> tuple[History, dict[str, Any]]:
    """The history of a result, and its data by name."""
    if not isinstance(result, xr.DataTree) or FLAT not in result.children:
        raise ValueError(
            f"The result of the filter is a {type(result).__name__}. Expected the result of infer, or the outputs of "
            "run_filter(..., collect=collect_history)."
        )
    assert smoother.model is not None
    check_same_model(result, smoother.model)
    if "smoother" in provenance(result):
        raise ValueError("The result is smoothed already. Expected that of a filter, which the smoother starts from.")
    key = jax.random.fold_in(rng_key, 0) if smoother.reads_particles else rng_key  # which nothing else then uses
    history = history_of_result(result, key, smoother.reads_particles)
    return history, arrays_of(result, "observed_data")


def _name(smoother: Smoother) -> str:
    """The builder of a smoother, as far as its function tells."""
    return getattr(smoother.smooth, "__qualname__", type(smoother.smooth).__name__).partition(".")[0]
