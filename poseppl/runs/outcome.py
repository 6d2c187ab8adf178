"""From a run of any model to its result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import xarray as xr
from jax import Array
from numpy.typing import ArrayLike, NDArray

from poseppl.program import CompiledModel, Observation
from poseppl.runs.contents import HISTORY, arrays_of, flat_draws, frame_numbers, group_of, names_of_result
from poseppl.runs.datasets import dataset_of
from poseppl.runs.filter_history import history_variables
from poseppl.runs.model_fingerprint import fingerprint_of
from poseppl.runs.results import Names, build_result, provenance
from poseppl.runs.run import Run
from poseppl.runs.smoothing import SmoothingRun
from poseppl.smoothers.base import History

_KEPT = ("observed_data", "faults", "truth", "inputs", "predictive")
"""Groups of a filter's result that its smoothing has, too, as it has others without frames but for `_CHECKS`."""
_CHECKS = ("hindcasts", "posterior_checks")
_GAUSSIAN_DRAWS = 500
"""Draws that stand for a frame's Gaussian where a smoother wants particles."""


def result_kwargs(run: Run | SmoothingRun) -> dict[str, Any]:
    """Contents of a run that collected draws, as arguments of :func:`poseppl.runs.results.build_result`.

    Args:
        run: The run.

    Returns:
        ``state``, ``sites``, ``extras``, ``sample_stats``, ``summary``, ``num_particles``, ``predictive``,
        ``history`` and ``attrs``.
    """
    if isinstance(run, SmoothingRun):
        return _parts_of_smoothing(run, {})
    stats: dict[str, Any] = run.info._asdict()
    stats.pop("ancestors")
    stats["acceptance_rate"] = stats.pop("acceptance")
    count = run.state.log_weights.shape[0]
    weighted = run.state.log_weights.ndim == 1
    if weighted:
        stats["acceptance_rate"] = np.full(len(run.unique_ancestors), np.nan)
        stats["unique_ancestors"] = run.unique_ancestors
    attrs: dict[str, Any] = {"frames_run": len(run.unique_ancestors) - run.resumed, "failed_frames": list(run.failed)}
    if run.warnings:
        attrs["warnings"] = list(run.warnings)
    parts = _parts(run, stats, count if weighted else None, attrs)
    checks = {} if run.prediction is None else run.prediction.by_name()
    return parts | {"predictive": checks or None, "history": history_variables(run.history)}


def result_of_run(
    run: Run | SmoothingRun,
    model: CompiledModel,
    observations: Observation | None = None,
    *,
    truth: ArrayLike | None = None,
    attrs: Mapping[str, Any] | None = None,
    **times: Any,
) -> xr.DataTree:
    """Assemble the result of a run or a smoothing whose collector was :func:`poseppl.runs.collectors.collect_draws`.

    Args:
        run: The run.
        model: The model that the filter or the smoother was built for; its coordinates give the names of ``state_dim``.
        observations: The data with a leading T, kept as ``observed_data`` with NaN where masked.
        truth: The true flat states (T, d), where known.
        attrs: Provenance: anything that JSON can hold.
        **times: ``frames``, their numbers (T,), 0, 1, ... if not given; ``rate``, frames a second.

    Returns:
        The result; see :mod:`poseppl.runs.results`.
    """
    parts = result_kwargs(run)
    attributes = {**(attrs or {}), **parts["attrs"], **angles_of(model), **fingerprint_of(model)}
    rounded = [] if observations is None else list(model.rounding_notes(observations).values())
    if rounded:
        attributes["warnings"] = [*rounded, *attributes.get("warnings", [])]
    return build_result(
        **{**parts, "attrs": attributes},
        names=Names(model.coordinate_names, values=model.finite_values),
        observed=None if observations is None else _with_nan(observations),
        truth={"state": truth},
        **times,
    )


def angles_of(model: CompiledModel) -> dict[str, list[str]]:
    """The attribute that names the coordinates that are angles, if any."""
    angles = [name for name, circular in zip(model.coordinate_names, model.circular_coordinates, strict=True) if circular]
    return {"circular": angles} if angles else {}


def smoothed_result(
    run: SmoothingRun, filtered: xr.DataTree, attrs: Mapping[str, Any], observations: Observation | None = None
) -> xr.DataTree:
    """Assemble the result of a smoothing from that of its filter, whose data, truth and provenance it has, too.

    Args:
        run: The smoothing.
        filtered: The result of the filter; ``log_evidence`` and ``failed`` of its statistics are kept, and as group
            ``filtered`` its moments and ``ess``.
        attrs: Provenance of the smoothing.
        observations: The data that were smoothed; those of the filter's result if None.
    """
    parts, known = _parts_of_smoothing(run, arrays_of(filtered, "sample_stats")), provenance(filtered)
    of_filter = {"filter seconds": known.get("wall_seconds"), "filter closed form": known.get("closed form")}
    recorded = {**known, **of_filter, **attrs, **parts.pop("attrs")}
    fitted = parts.pop("others", {})
    summary, stats = group_of(filtered, "summary"), group_of(filtered, "sample_stats")
    before = dataset_of(
        {name: summary.variables[name] for name in ("state_mean", "state_sd")}
        | ({"ess": stats.variables["ess"]} if "ess" in stats.variables else {}),
        summary.coords,
    )
    kept = [
        name
        for name, group in filtered.children.items()
        if (name in _KEPT or ("frame" not in group.sizes and name not in _CHECKS))
        and (observations is None or name != "observed_data")
    ]
    return build_result(
        **parts,
        names=names_of_result(filtered),
        observed=None if observations is None else _with_nan(observations),
        others={**fitted, **{name: group_of(filtered, name) for name in kept}, "filtered": before},
        frames=frame_numbers(filtered),
        rate=filtered.attrs.get("rate"),
        attrs={name: value for name, value in recorded.items() if value is not None},
    )


def history_of_result(tree: xr.DataTree, rng_key: Array, particles: bool = True) -> History:
    """Start of smoothers: the filter's particles, draws of its Gaussians, or else the draws of the result.

    Args:
        tree: The result of a filter.
        rng_key: PRNG key of the draws of Gaussians.
        particles: Whether the smoother reads them; without, the mean stands for them.
    """
    kept = arrays_of(tree, HISTORY)
    failed = np.asarray(tree["sample_stats"].dataset["failed"].values, bool)
    if not particles:
        return _equal_weights(tree["summary"].dataset["state_mean"].values[:, None], failed)
    if "state" in kept:
        ancestors = kept.get("ancestor", np.zeros((len(failed), 0), np.int32))
        return History(kept["state"], kept["log_weight"], ancestors, failed)  # type: ignore[arg-type]
    if "mean" in kept:
        return _equal_weights(_gaussian_draws(kept, rng_key), failed)
    draws = flat_draws(tree).transpose("frame", "chain", "draw", "state_dim").values
    return _equal_weights(draws.reshape(len(draws), -1, draws.shape[-1]), failed)


def _gaussian_draws(moments: Mapping[str, Any], rng_key: Array) -> NDArray[Any]:
    """Draws (T, N, d) of Gaussians, of which some coordinates may have no variance."""
    mean, covariance = moments["mean"], np.asarray(moments["covariance"], np.float64)
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
    generator = np.random.default_rng(np.asarray(jax.random.key_data(rng_key)).ravel().tolist())
    noise = generator.standard_normal((len(mean), _GAUSSIAN_DRAWS, mean.shape[-1]))
    draws: NDArray[Any] = mean[:, None] + noise @ np.swapaxes(roots, 1, 2)
    return draws.astype(mean.dtype)


def _equal_weights(particles: NDArray[Any], failed: NDArray[Any]) -> History:
    frames, count = particles.shape[:2]
    log_weights = np.full((frames, count), -np.log(count), particles.dtype)
    return History(particles, log_weights, np.zeros((frames, 0), np.int32), failed)  # type: ignore[arg-type]


def _parts_of_smoothing(run: SmoothingRun, filtered: Mapping[str, ArrayLike]) -> dict[str, Any]:
    num_frames = len(run.info.ess)
    moves = run.num_particles is None
    stats: dict[str, Any] = {name: np.asarray(filtered[name]) for name in ("log_evidence", "failed") if name in filtered}
    stats |= {
        "ess": run.info.ess,
        "acceptance_rate": run.info.acceptance if moves else np.full(num_frames, np.nan),
        "num_transition": np.full(num_frames, run.info.num_transition / num_frames),
        "num_gradient": np.full(num_frames, run.info.num_gradient / num_frames),
        "unreachable": run.info.unreachable,
    }
    parts = _parts(run, stats, run.num_particles, {"frames_run": num_frames, "divergences": int(run.info.divergences)})
    if run.approximation is None:
        return parts
    bound, log_ratios = run.approximation
    fitted = xr.Dataset({"bound": ("step", bound), "log_ratio": ("trajectory", log_ratios)})
    return parts | {"others": {"approximation": fitted}}


def _parts(
    run: Run | SmoothingRun, sample_stats: Mapping[str, Any], num_particles: int | None, attrs: Mapping[str, Any]
) -> dict[str, Any]:
    outputs = run.outputs
    if not hasattr(outputs, "summary"):
        raise ValueError(
            f"The collector kept a {type(outputs).__name__} of each frame. Expected draws for a result: use "
            "collect_draws, or use the outputs of run_filter directly."
        )
    times = {"wall_seconds": run.wall_seconds, "cpu_seconds": run.cpu_seconds, "compile_seconds": run.compile_seconds}
    return {
        "state": _by_chain(outputs.state),
        "sites": {name: _by_chain(values) for name, values in outputs.sites.items()},
        "extras": {name: _by_chain(values) for name, values in outputs.extras.items()},
        "sample_stats": sample_stats,
        "summary": outputs.summary,
        "num_particles": num_particles,
        "attrs": {**run.method, **times, **attrs},
    }


def _by_chain(values: NDArray[Any]) -> NDArray[Any]:
    """(frame, chain, draw, ...) to (chain, draw, frame, ...)."""
    return np.moveaxis(values, 0, 2)


def _with_nan(observations: Observation) -> dict[str, NDArray[Any]]:
    data = {}
    for name, values in observations.values.items():
        mask = np.asarray(observations.mask[name])
        data[name] = np.asarray(values) if mask.all() else np.where(mask, values, np.nan)
    return data
