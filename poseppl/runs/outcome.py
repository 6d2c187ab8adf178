"""From a run of any model to its result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.program import CompiledModel, Observation
from poseppl.runs.results import Names, Truth, build_result
from poseppl.runs.run import Run
from poseppl.runs.smoothing import SmoothingRun
from poseppl.smoothers.base import History


def parts_of_run(run: Run) -> dict[str, Any]:
    """Contents of a run that collected draws, as arguments of :func:`poseppl.runs.results.build_result`.

    Args:
        run: The run.

    Returns:
        ``state``, ``extras``, ``sample_stats``, ``summary``, ``num_particles`` and ``predictive``.
    """
    stats: dict[str, Any] = run.info._asdict()
    stats.pop("ancestors")
    stats["acceptance_rate"] = stats.pop("acceptance")
    particles = run.state.particles
    weighted = particles.ndim == 2
    if weighted:
        stats["acceptance_rate"] = np.full(len(run.unique_ancestors), np.nan)
        stats["unique_ancestors"] = run.unique_ancestors
    parts = _parts(run.outputs, stats, particles.shape[0] if weighted else None)
    return parts | {"predictive": None if run.prediction is None else run.prediction._asdict()}


def result_of_run(
    run: Run,
    model: CompiledModel,
    observations: Observation | None = None,
    *,
    truth: ArrayLike | None = None,
    frames: ArrayLike | None = None,
    rate: float | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.DataTree:
    """Assemble the result of a run whose collector was :func:`poseppl.runs.collectors.collect_draws`.

    Args:
        run: The run.
        model: The model that the filter was built for; its coordinates give the names of ``dof``.
        observations: The data with a leading T, kept as ``observed_data`` with NaN where masked.
        truth: The true flat states (T, d), where known.
        frames: Frame numbers (T,); 0, 1, ... if None.
        rate: Frames a second.
        attrs: Provenance: anything that JSON can hold.

    Returns:
        The result; see :mod:`poseppl.runs.results`.
    """
    told = {**(attrs or {}), **provenance_of_run(run)}
    return _result(parts_of_run(run), model, observations, truth=truth, frames=frames, rate=rate, attrs=told)


def provenance_of_run(run: Run) -> dict[str, Any]:
    """Provenance of a run as a whole."""
    seconds = {"wall_seconds": run.wall_seconds, "compile_seconds": run.compile_seconds}
    return {**run.method, **seconds, "frames_run": len(run.unique_ancestors) - run.resumed, "failed_frames": list(run.failed)}


def parts_of_smoothing(run: SmoothingRun, filtered: Mapping[str, ArrayLike]) -> dict[str, Any]:
    """Contents of a smoothing that collected draws, as arguments of :func:`poseppl.runs.results.build_result`.

    Args:
        run: The smoothing.
        filtered: The filter's ``sample_stats``, (frame,) each; its ``log_evidence`` and ``failed`` are kept.

    Returns:
        ``state``, ``extras``, ``sample_stats``, ``summary`` and ``num_particles``.
    """
    num_frames = len(run.info.ess)
    moves = run.num_particles is None
    stats: dict[str, Any] = {name: np.asarray(filtered[name]) for name in ("log_evidence", "failed") if name in filtered}
    stats |= {
        "ess": run.info.ess,
        "acceptance_rate": run.info.acceptance if moves else np.full(num_frames, np.nan),
        "num_transition": np.full(num_frames, run.info.num_transition / num_frames),
        "num_gradient": np.full(num_frames, run.info.num_gradient / num_frames),
    }
    return _parts(run.outputs, stats, run.num_particles)


def result_of_smoothing(
    run: SmoothingRun,
    model: CompiledModel,
    observations: Observation | None = None,
    *,
    filtered: Mapping[str, ArrayLike] | None = None,
    truth: ArrayLike | None = None,
    frames: ArrayLike | None = None,
    rate: float | None = None,
    attrs: Mapping[str, Any] | None = None,
) -> xr.DataTree:
    """Assemble the result of a smoothing whose collector was :func:`poseppl.runs.collectors.collect_draws`.

    Args:
        run: The smoothing.
        model: The compiled model; its coordinates give the names of ``dof``.
        observations: The data with a leading T, kept as ``observed_data`` with NaN where masked.
        filtered: The filter's ``sample_stats``, of which ``log_evidence`` and ``failed`` are kept.
        truth: The true flat states (T, d), where known.
        frames: Frame numbers (T,); 0, 1, ... if None.
        rate: Frames a second.
        attrs: Provenance: anything that JSON can hold.
    """
    parts, told = parts_of_smoothing(run, filtered or {}), {**(attrs or {}), **provenance_of_smoothing(run)}
    return _result(parts, model, observations, truth=truth, frames=frames, rate=rate, attrs=told)


def provenance_of_smoothing(run: SmoothingRun) -> dict[str, Any]:
    """Provenance of a smoothing as a whole."""
    seconds = {"wall_seconds": run.wall_seconds, "compile_seconds": run.compile_seconds}
    return {**run.method, **seconds, "frames_run": len(run.info.ess), "divergences": int(run.info.divergences)}


def history_of_result(tree: xr.DataTree) -> History:
    """The draws of a result as a filter's history; those of weighted particles were resampled, and have no genealogy."""
    state = tree["posterior"].dataset["state"].transpose("frame", "chain", "draw", "dof").values
    particles = state.reshape(state.shape[0], -1, state.shape[-1])
    frames, count = particles.shape[:2]
    failed = np.asarray(tree["sample_stats"].dataset["failed"].values, bool)
    log_weights = np.full((frames, count), -np.log(count), particles.dtype)
    return History(particles, log_weights, np.zeros((frames, 0), np.int32), failed)  # type: ignore[arg-type]


def _parts(outputs: Any, sample_stats: Mapping[str, Any], num_particles: int | None) -> dict[str, Any]:
    if not hasattr(outputs, "summary"):
        raise ValueError(
            f"The collector kept a {type(outputs).__name__} of each frame. Expected draws, which a result is made of: use "
            "collect_draws, or take the outputs of run_filter as they are."
        )
    return {
        "state": _by_chain(outputs.state),
        "extras": {name: _by_chain(values) for name, values in outputs.extras.items()},
        "sample_stats": sample_stats,
        "summary": outputs.summary,
        "num_particles": num_particles,
    }


def _result(
    parts: Mapping[str, Any], model: CompiledModel, observations: Observation | None, *, truth: ArrayLike | None, **rest: Any
) -> xr.DataTree:
    return build_result(
        **parts,
        names=Names(model.coordinate_names),
        observed=None if observations is None else _with_nan(observations),
        truth=None if truth is None else Truth(state=truth),
        **rest,
    )


def _by_chain(values: NDArray[Any]) -> NDArray[Any]:
    """(frame, chain, draw, ...) to (chain, draw, frame, ...)."""
    return np.moveaxis(values, 0, 2)


def _with_nan(observations: Observation) -> dict[str, NDArray[Any]]:
    data = {}
    for name, values in observations.values.items():
        mask = np.asarray(observations.mask[name])
        data[name] = np.asarray(values) if mask.all() else np.where(mask, values, np.nan)
    return data
