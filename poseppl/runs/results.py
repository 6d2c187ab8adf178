"""Result of a run: an xarray DataTree with named coordinates, which ArviZ's functions take unchanged from version 1 on.

===========================  =================================================================================================
group                        variables
===========================  =================================================================================================
``posterior``                the state's sites by name, as the programs know them, (chain, draw, frame, ...), and the model's
                             extras, its deterministic sites
``unconstrained_posterior``  ``state`` (chain, draw, frame, state_dim), the flat vectors that algorithms see: logarithms of
                             what is positive, stick-breaking coordinates of what adds up to one
``sample_stats``             one value a frame: ``log_evidence``, ``ess``, ``acceptance_rate``, ``divergences``, ...
``summary``                  ``state_mean``, ``state_sd``, ``state_quantile`` (frame, quantile, state_dim), made over all
                             draws or particles, where ``posterior`` may hold a thinning of them;
                             where the algorithm knows the moments of the flat state they are these, without error of draws;
                             of a site ``NAME_mean``, ``NAME_sd``, ``NAME_quantile``, or of one of finitely many values
                             ``NAME_probability`` (frame, ..., NAME_value)
``observed_data``            the data by name, (frame, ...); NaN where missing
``faults``                   probabilities, given all data, that data are wrong, (frame, ...)
``truth``                    where there is one: ``state`` (frame, state_dim), and what else is known, (frame, ...)
``inputs``                   what else the model was given, so that a smoother finds it again
``predictive``               each frame's data against their prediction, see :class:`poseppl.runs.predictive.Prediction`:
                             ``transform``, ``innovation``, ``state_variance``, ``noise_variance`` (frame, entry),
                             ``chi_square`` and ``chi_square_transform`` (frame,); of a smoothed result those of its filter
``filtered``                 of a smoothed result its filter's ``state_mean``, ``state_sd`` and ``ess``
``filter_history``           of a filter's result what smoothers start from: ``state`` (frame, particle, state_dim),
                             ``log_weight`` and ``ancestor`` (frame, particle) of weighted particles, the index of the one
                             before that each descends from; or ``mean`` (frame, state_dim) and ``covariance`` (frame,
                             state_dim, other_state_dim); ``filter_state_dim`` where the result's state is another
``hindcasts``                added by :func:`poseppl.diagnostics.add_hindcasts`
``posterior_checks``         added by :func:`poseppl.runs.posterior_checks.check_posterior`
``diagnostics``              added by :func:`poseppl.diagnostics.diagnose`
others                       what a package adds to its results, such as :mod:`poseppl.motion.tracking.body_result`
===========================  =================================================================================================

Weighted particles have no chains: their ``posterior`` is one chain of draws resampled by weight, and the root attribute
``num_particles`` holds the number of particles behind each frame. The attribute ``joint`` of a smoothed result says whether
draws of one index are one trajectory along the frames. The provenance is in the root attributes, as JSON.

>>> tree = build_result(state=np.zeros((2, 5, 3, 1)), names=Names(state_dim=("level",)), attrs={"model": "random walk"})
>>> tree["posterior"].sizes["draw"], provenance(tree)["model"]
(5, 'random walk')
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.files.netcdf import read_netcdf, write_netcdf
from poseppl.runs.contents import FLAT, HISTORY, group_of
from poseppl.runs.datasets import tree_of
from poseppl.runs.filter_history import HISTORY_AXES
from poseppl.runs.labels import QUANTILES as QUANTILES, Dims, Names as Names, checked, coordinates, labelled, labelled_summary

_PROBE, _WORTH = 8192, 0.7
"""Numbers of an array that are packed to see whether all are to be, and the share of their bytes that may be left."""
VERSION = 2
"""Version of the layout, in the root attribute ``poseppl_result``."""

_CHECK_AXES = {
    **dict.fromkeys(("predicted_mean", "predicted_variance", "predicted_error", "autoregression"), ("frame", "state_dim")),
    **dict.fromkeys(("explained", "weighted_mean"), ("frame", "state_dim")),
    **dict.fromkeys(("weighted_covariance", "memory", "transfer"), ("frame", "state_dim", "other_state_dim")),
    "weighted_draws": ("frame", "weighted_draw", "state_dim"),
}
"""Axes of predictive checks that are of the state's coordinates, rather than of the data's entries."""


_LEADING = ("chain", "draw", "frame")


def build_result(
    *,
    state: ArrayLike,
    names: Names,
    sites: Mapping[str, ArrayLike] | None = None,
    extras: Mapping[str, ArrayLike] | None = None,
    sample_stats: Mapping[str, ArrayLike] | None = None,
    summary: Mapping[str, ArrayLike] | None = None,
    quantiles: Sequence[float] = QUANTILES,
    observed: Mapping[str, ArrayLike] | None = None,
    faults: Mapping[str, ArrayLike] | None = None,
    truth: Mapping[str, ArrayLike | None] | None = None,
    inputs: Mapping[str, ArrayLike] | None = None,
    predictive: Mapping[str, ArrayLike] | None = None,
    history: Mapping[str, ArrayLike] | None = None,
    frames: ArrayLike | None = None,
    rate: float | None = None,
    num_particles: int | None = None,
    attrs: Mapping[str, Any] | None = None,
    others: Mapping[str, xr.Dataset] | None = None,
) -> xr.DataTree:
    """Assemble the result of a run.

    Args:
        state: (chain, draw, frame, state_dim) draws.
        names: Names of the coordinates.
        sites: Draws of the state's sites, (chain, draw, frame, ...); the flat state itself is the only site if None.
        extras: Draws of the model's deterministic sites, (chain, draw, frame, ...).
        sample_stats: (frame,) each.
        summary: ``state_mean`` (frame, state_dim), ``state_sd``, ``state_quantile`` (frame, quantile, state_dim), and the
            like for extras. Those of ``state`` are computed from the draws if absent.
        quantiles: Levels of the quantiles, ascending.
        observed: The data by name, (frame, ...) each, NaN where missing.
        faults: Probabilities that data are wrong, (frame, ...) each.
        truth: The truth by name, (frame, ...) each: ``state``, and whatever else is known; None where it is not.
        inputs: Inputs of the model, by name, for smoothers.
        predictive: Predictive checks, (frame, entry), (frame, state_dim) or (frame,) each.
        history: Record of the filter for smoothers, by name.
        frames: (frame,) frame numbers; 0, 1, ... if None.
        rate: Frames a second.
        num_particles: Number of weighted particles behind the draws of a frame; None where the draws are Markov chains.
        attrs: Provenance: anything that JSON can hold.
        others: Further groups as they are, such as those of another result.

    Returns:
        The tree.

    Raises:
        ValueError: A shape does not agree with the names.
    """
    draws = np.asarray(state)
    if draws.ndim != 4:
        raise ValueError(f"state has shape {draws.shape}; expected (chain, draw, frame, state_dim)")
    known = coordinates(names, draws.shape, frames, quantiles)
    posterior = {**(extras or {}), **({"state": draws} if sites is None else sites)}
    dims, flat = names.dims, {"state": draws}
    groups = {
        "posterior": labelled(posterior, _LEADING, known, dims),
        FLAT: labelled(flat, _LEADING, known),
        "sample_stats": labelled(sample_stats or {}, ("frame",), known, dims),
        "summary": _summary(draws, summary or {}, known, dims),
    }
    for group, given in {"observed_data": observed, "faults": faults, "truth": truth}.items():
        present = {name: values for name, values in (given or {}).items() if values is not None}
        if present:
            groups[group] = labelled(present, ("frame",), known, dims)
    if inputs is not None:
        groups["inputs"] = labelled(inputs, (), known, dims)
    groups |= _of_algorithms(known, predictive, history or {})
    return tree_of(groups | dict(others or {}), _root_attrs(rate, num_particles, attrs or {}))


def _of_algorithms(
    known: xr.Coordinates,
    predictive: Mapping[str, ArrayLike] | None,
    history: Mapping[str, ArrayLike],
) -> dict[str, xr.Dataset]:
    """Groups of the algorithm for checks and smoothers, without empty ones."""
    groups = {}
    if predictive is not None:
        groups["predictive"] = _predictive(predictive, known)
    if history:
        parts = {name: (HISTORY_AXES[name], np.asarray(values)) for name, values in history.items()}
        if "state" in parts and parts["state"][1].shape[-1] != known.sizes.get("state_dim"):
            parts["state"] = (("frame", "particle", "filter_state_dim"), parts["state"][1])
        groups[HISTORY] = checked(parts, known)
    return groups


def save_result(tree: xr.DataTree, path: FilePath) -> None:
    """Write a result as NetCDF, compressed where that helps; the file appears under its name only when it is whole.

    Args:
        tree: The result.
        path: The file, overwritten if it exists.

    Raises:
        InputError: The folder is missing or cannot be written.
        PosepplError: The disk is full.
    """
    encoding: dict[str, dict[str, Any]] = {}
    for node in tree.subtree:
        packed = [str(name) for name, variable in node.dataset.data_vars.items() if _shrinks(variable.values)]
        if packed:
            encoding[node.path] = {name: {"zlib": True, "complevel": 2, "shuffle": True} for name in packed}
    write_netcdf(tree, path, encoding)


def _shrinks(values: NDArray[Any]) -> bool:
    """Whether numbers are worth packing, by some of them: deflate needs half of the time, and leaves four fifths of draws."""
    if values.dtype.kind not in "fiub" or not values.ndim or not values.size:
        return False
    middle = max(0, values.size // 2 - _PROBE // 2)
    part = values.flat[middle : middle + _PROBE]
    shuffled = part.view(np.uint8).reshape(len(part), -1).T.tobytes()
    return len(zlib.compress(shuffled, 2)) < _WORTH * len(shuffled) if shuffled else True


def load_result(path: FilePath, *, max_bytes: int | None = None) -> xr.DataTree:
    """Read a result into memory.

    Args:
        path: A file that :func:`save_result` wrote.
        max_bytes: The most that it may hold when unpacked; 4 GiB by default, or what POSEPPL_MAX_GIB says.

    Returns:
        The tree.

    Raises:
        InputError: The file is missing, no NetCDF, damaged, declares too much, or holds no result of poseppl.
    """
    expected = "a results file written by poseppl track"
    tree = read_netcdf(path, expected=expected, max_bytes=max_bytes)
    version = tree.attrs.get("poseppl_result")
    if "poseppl_fit" in tree.attrs:
        wanted = Phrase("a result; poseppl run with ", Argument("fit"), ", or infer(..., params=fitted), makes one")
        raise InputError("a fit of parameters, not a result of poseppl", file=path, expected=wanted)
    if version is None or (version == VERSION and "state" not in group_of(tree, FLAT)):
        raise InputError("a NetCDF file, but not a result of poseppl", file=path, expected=expected)
    if version != VERSION:
        raise InputError(f"results of layout {version}", file=path, expected=f"layout {VERSION}: run the tracking again")
    return tree


def provenance(tree: xr.DataTree) -> dict[str, Any]:
    """Read the provenance of a result from its root attributes.

    Args:
        tree: The result.

    Returns:
        The value of ``attrs`` in :func:`build_result`.
    """
    return {str(name): _decode(value) for name, value in tree.attrs.items() if name not in _RESERVED}


def encoded(attrs: Mapping[str, Any]) -> dict[str, str]:
    """Provenance as a result's attributes hold it."""
    return {name: json.dumps(value) for name, value in attrs.items()}


def is_weighted(tree: xr.DataTree) -> bool:
    """Whether the draws of a result were resampled from weighted particles, rather than made by Markov chains."""
    return "num_particles" in tree.attrs


_RESERVED = ("poseppl_result", "rate", "num_particles")


def _root_attrs(rate: float | None, num_particles: int | None, attrs: Mapping[str, Any]) -> dict[str, Any]:
    clash = sorted(set(attrs) & set(_RESERVED))
    if clash:
        raise ValueError(f"the attributes {clash} are reserved; give rate and num_particles as arguments")
    root: dict[str, Any] = {"poseppl_result": VERSION}
    if rate is not None:
        root["rate"] = float(rate)
    if num_particles is not None:
        root["num_particles"] = int(num_particles)
    return root | encoded(attrs)


def _decode(value: Any) -> Any:
    try:
        return _printable(json.loads(value))
    except (TypeError, ValueError, RecursionError):
        return _printable(str(value)) if isinstance(value, str) else value


def _printable(value: Any) -> Any:
    """The value with "?" for what is no character: names of files need not be text."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode("utf-8")
    if isinstance(value, list):
        return [_printable(item) for item in value]
    if isinstance(value, dict):
        return {_printable(name): _printable(item) for name, item in value.items()}
    return value


def _predictive(predictive: Mapping[str, ArrayLike], known: xr.Coordinates) -> xr.Dataset:
    checks = {name: np.asarray(values) for name, values in predictive.items()}
    axes = {name: _CHECK_AXES.get(name, ("frame", "entry"))[: values.ndim] for name, values in checks.items()}
    return checked({name: (axes[name], values) for name, values in checks.items()}, known)


def _summary(draws: NDArray[Any], given: Mapping[str, ArrayLike], known: xr.Coordinates, dims: Dims) -> xr.Dataset:
    computed = {} if "state_mean" in given else draw_moments("state", draws, known["quantile"].values)
    return labelled_summary(computed | dict(given), ("frame",), known, dims)


def draw_moments(name: str, values: ArrayLike, levels: Sequence[float] | NDArray[Any] = QUANTILES) -> dict[str, NDArray[Any]]:
    """Summarise draws.

    Args:
        name: Name of the variable.
        values: (chain, draw, frame, ...).
        levels: Levels of the quantiles.

    Returns:
        ``NAME_mean``, ``NAME_sd`` (frame, ...) and ``NAME_quantile`` (frame, quantile, ...).
    """
    draws = np.asarray(values)
    pooled = draws.reshape(-1, *draws.shape[2:])
    quantile = np.moveaxis(np.quantile(pooled, levels, axis=0), 0, 1)
    spread = pooled.std(axis=0, ddof=1) if len(pooled) > 1 else np.full(pooled.shape[1:], np.nan)
    parts = {"mean": pooled.mean(axis=0, dtype=np.float64), "sd": spread, "quantile": quantile}
    return {f"{name}_{part}": values.astype(draws.dtype) for part, values in parts.items()}
