"""Runs of a user's own model for `poseppl run` and `poseppl batch`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from poseppl.cli.checks import rows_of_text
from poseppl.cli.options import chosen
from poseppl.cli.remedies import as_option
from poseppl.cli.user_model import bound_programs, load_programs, read_series, series_of, source_digest
from poseppl.diagnostics import add_hindcasts, diagnose, verdicts
from poseppl.errors import InputError, UnsuitableModelError
from poseppl.filters.suitability import compatible_filters
from poseppl.fitting import load_fit
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.collectors import collect_draws
from poseppl.runs.fitted_params import fitted_params
from poseppl.runs.forecasting import hindcast
from poseppl.runs.frame_gaps import Gaps, inputs_of_all_frames
from poseppl.runs.infer import infer, smooth
from poseppl.runs.posterior_checks import check_posterior
from poseppl.runs.predictive import predictive_checks
from poseppl.runs.results import provenance


class Filtered(NamedTuple):
    """A result, and the model and inputs (T, ...) that a smoother of it wants."""

    result: xr.DataTree
    model: CompiledModel
    inputs: Any


def filtered(name: str, path: str, options: Mapping[str, Any], progress: Any) -> Filtered:
    """Filter the data of a file.

    Args:
        name: The model, ``FILE.py[:NAME]``.
        path: The table.
        options: Those of the command.
        progress: Reports the run's progress.

    Raises:
        InputError: The model, the data or a setting cannot be used.
    """
    algorithm = FILTERS[options["filter_name"]]
    algorithm.check(options["settings"])
    progress.stage("reading")
    table, inputs = read_series(path, tuple(options["inputs"]), rows_of_text(options.get("frames")))
    model = _compiled(name, source_digest(name), tuple(options["inputs"]), given_params(options))
    series = series_of(model, table, inputs, path)
    for error in table.misspelt:
        progress.note(f"{error}; nothing uses that column, which is left out")
    filter, settings = algorithm.build(model, options["settings"])
    gaps = Gaps(range(len(next(iter(table.columns.values())))) if series.frames is None else series.frames)
    filling = bool(gaps) and options["fill_gaps"]
    progress.stage("compiling", total=len(gaps.numbers if filling else gaps.frames))
    first = None if inputs is None else {key: values[0] for key, values in inputs.items()}
    checks = None if model.why_not_predictive(first) else predictive_checks(model)
    attrs = {"input": Path(path).name, "model": name, "filter": algorithm.name, "settings": settings, "seed": options["seed"]}
    key = jax.random.key(options["seed"])
    collect = collect_draws(model, max_draws=options["max_draws"])
    about: dict[str, Any] = {"frames": gaps.frames, "rate": options.get("rate"), "attrs": attrs, "fill_gaps": filling}
    about |= chosen(options, "history_mib")
    try:
        result = infer(model, series.data, filter, key, inputs, collect=collect, predict=checks, progress=progress, **about)
    except UnsuitableModelError as error:
        others = [each for each in (*compatible_filters(model), "particle") if each != algorithm.name]
        raise InputError(str(error), field=f"--filter {algorithm.name}", expected=" or ".join(others)) from error
    except ValueError as error:
        raise InputError(str(error), file=path) from error
    inputs = inputs_of_all_frames(inputs, gaps.frames) if filling else inputs
    if options["hindcast"]:
        progress.stage("forecasting")
        predicted = hindcast(result, model, options["hindcast"], jax.random.fold_in(key, 1), inputs)
        result = add_hindcasts(result, predicted)
    return Filtered(diagnose(result), model, inputs)


def given_params(options: Mapping[str, Any]) -> tuple[tuple[str, Any], ...]:
    """Parameters by name, arrays as nested tuples: those of a fit, and in their place those that are given one by one.

    Raises:
        InputError: The file holds no fit, or the fit has no estimate of one.
    """
    path = options.get("fit_file")
    fitted = fitted_params(load_fit(path)) if path else {}
    return tuple(sorted(({name: _tuples(value.tolist()) for name, value in fitted.items()} | options["params"]).items()))


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


@lru_cache(maxsize=4)
def _compiled(name: str, digest: str, inputs: tuple[str, ...], params: tuple[tuple[str, Any], ...]) -> CompiledModel:
    """The model, once for all tables of a process, so that its filters are compiled once."""
    example = {key: np.zeros(1, jnp.result_type(float)) for key in inputs} or None
    return bound_programs(load_programs(name), example, dict(params) or None)


def smoothed(found: Filtered, options: Mapping[str, Any], progress: Any) -> xr.DataTree:
    """Smooth a result.

    Raises:
        InputError: The smoother is not for such a model.
    """
    progress.stage("smoothing")
    smoother, _ = SMOOTHERS[options["smooth"]].build(found.model, {})
    collect = collect_draws(found.model, max_draws=options["max_draws"])
    key, attrs = jax.random.key(options["seed"]), {"smoother": options["smooth"]}
    try:
        result = smooth(found.result, smoother, key, found.inputs, collect=collect, attrs=attrs)
    except ValueError as error:
        raise InputError(str(error), field="--smooth") from error
    return diagnose(check_posterior(result, found.model, jax.random.fold_in(key, 1), found.inputs))


def described(tree: xr.DataTree, files: Sequence[tuple[str, Path]]) -> dict[str, Any]:
    """Summary of a run, of types that JSON has."""
    known, stats = provenance(tree), tree["sample_stats"].dataset
    evidence = float(stats["log_evidence"].sum()) if "log_evidence" in stats else math.nan
    last = tree["summary"].dataset.isel(frame=-1)
    means = {str(name).removesuffix("_mean"): last[name].values for name in last if str(name).endswith("_mean")}
    probabilities = {str(name): last[name].values for name in last if str(name).endswith("_probability")}
    return {
        "input": known.get("input"),
        "model": known.get("model"),
        "filter": known.get("filter"),
        **({"smoother": known["smoother"]} if "smoother" in known else {}),
        "frames": int(stats.sizes["frame"]),
        "impossible frames": int(np.asarray(stats["failed"]).sum()),
        "log evidence": evidence if math.isfinite(evidence) else None,
        "seconds": round(float(known.get("wall_seconds", math.nan)), 3),
        "compilation, seconds": round(float(known.get("compile_seconds", math.nan)), 3),
        **{what: str(path) for what, path in files},
        "last frame": {
            name: value.tolist()
            for name, value in (means | probabilities).items()
            if name != "state" and np.isfinite(value).all()
        },
        "verdicts": [{"severity": each.severity, "text": each.worded(as_option)} for each in verdicts(tree)],
    }
