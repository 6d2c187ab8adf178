"""A user's own model and data on the command line, and their runs for `poseppl run` and `poseppl batch`."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.cli.checks import rows_of_text
from poseppl.cli.options import as_option, chosen
from poseppl.diagnostics import add_hindcasts, diagnose, verdicts
from poseppl.errors import InputError, UnsuitableModelError, brief
from poseppl.files.table_reading import NumberTable, read_table
from poseppl.files.user_code import file_of_module, import_named
from poseppl.filters.suitability import compatible_filters
from poseppl.fitting import load_fit
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.collectors import collect_draws
from poseppl.runs.columns import FRAME, columns_of, frames_of
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


_EXPECTED = "a StateSpaceModel, or a function without arguments that returns one, such as model = StateSpaceModel(...)"


class Series(NamedTuple):
    """One series from a file: data and inputs by name, (T, ...), and frame numbers (T,) or None."""

    data: dict[str, NDArray[Any]]
    inputs: dict[str, NDArray[Any]] | None
    frames: NDArray[np.int64] | None


def source_digest(name: str) -> str:
    """Path and hash of the file of ``FILE.py[:NAME]`` or ``package.module[:NAME]``; nothing where there is none."""
    place = name.partition(":")[0]
    path = Path(place if place.endswith(".py") else file_of_module(place))
    if path.suffix != ".py" or not path.is_file():
        return ""
    return f"{path.resolve()} {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}"


def load_programs(name: str) -> StateSpaceModel:
    """The programs that ``FILE.py[:NAME]`` or ``package.module[:NAME]`` defines, by default ``model``; runs its code.

    Raises:
        InputError: It is not found, or is something else.
    """
    place, colon, attribute = name.rpartition(":")
    place, attribute = (place, attribute) if colon else (name, "model")
    module = import_named(place, "MODEL")
    found = getattr(module, attribute, None)
    if found is None:
        known = [key for key, value in vars(module).items() if isinstance(value, StateSpaceModel)]
        raise InputError(f"{place} has no {brief(attribute)}", field="MODEL", expected=", ".join(known) or _EXPECTED)
    if callable(found) and not isinstance(found, StateSpaceModel):
        try:
            found = found()
        except Exception as error:  # the user's own code
            raise InputError(f"{name} fails: {type(error).__name__}: {error}", field="MODEL", expected=_EXPECTED) from error
    if isinstance(found, CompiledModel):
        found = found.programs
    if not isinstance(found, StateSpaceModel):
        raise InputError(f"{name} is a {type(found).__name__}", field="MODEL", expected=_EXPECTED)
    return found


def compile_programs(programs: StateSpaceModel, inputs: Any, params: Mapping[str, Any] | None = None) -> CompiledModel:
    """Compile them, for the inputs (T, ...) that a table has.

    Raises:
        InputError: They are no state-space model.
    """
    first = None if inputs is None else {name: values[0] for name, values in inputs.items()}
    try:
        return programs.compile(first, params)
    except ValueError as error:
        hints = (
            ["--inputs NAME for each column that they read"] * (inputs is None),
            ["--param NAME=NUMBER"] * (params is None and programs.parameters is None),
        )
        expected = " and ".join(part for hint in hints for part in hint) if "It got" in str(error) else ""
        raise InputError(str(error), field="MODEL", expected=expected or None) from error


def bound_programs(programs: StateSpaceModel, inputs: Any, params: Mapping[str, Any] | None) -> CompiledModel:
    """Compile them with their parameters, if they have any.

    Raises:
        InputError: They are no state-space model, or want parameters, or others.
    """
    number = jnp.result_type(float)
    given = None if params is None else {name: np.asarray(value, number) for name, value in params.items()}
    if programs.parameters is None:
        return compile_programs(programs, inputs, given)
    model = compile_programs(programs, inputs)
    wanted = list(jax.eval_shape(model.sample_parameters, jax.random.key(0)))
    if given is None or set(wanted) != set(given):
        expected = " ".join(f"--param {name}=NUMBER" for name in wanted) + ", or --fit FILE of poseppl fit"
        others = f", and not {', '.join(given)}" if given else ""
        raise InputError(f"its programs have parameters{others}", field="MODEL", expected=expected)
    return model.with_params(given)


def read_series(path: str | Path, input_names: tuple[str, ...], rows: slice) -> tuple[NumberTable, Any]:
    """A table, some of its rows, and the inputs among its columns by name; None where no input is named.

    Raises:
        InputError: The table cannot be read, has no such rows, or lacks an input.
    """
    whole = read_table(path)
    table = whole._replace(columns={name: values[rows] for name, values in whole.columns.items()})
    if not (table.columns or table.unread) or any(not len(values) for values in table.columns.values()):
        raise InputError("there is no such row", file=path, field="--frames", expected="rows of the table, counted from 0")
    _check_read(table, input_names)
    missing = [name for name in input_names if name not in table.columns]
    if missing:
        expected = f"some of {', '.join(table.columns)}"
        raise InputError(f"no column {brief(missing[0])}", file=path, field="--inputs", expected=expected)
    return table, {name: np.asarray(table.columns[name], np.float64) for name in input_names} or None


def _check_read(table: NumberTable, names: Collection[str]) -> None:
    """Refuse to go without what a column of one of these names, or an entry of one, holds in place of numbers."""
    for name, error in table.unread.items():
        if name in names or name.partition("[")[0] in names:
            raise error


def series_of(model: CompiledModel, table: NumberTable, inputs: Any, path: str | Path) -> Series:
    """Data, inputs and frame numbers for a model.

    Raises:
        InputError: A column is missing or holds no numbers, or the data do not fit the model.
    """
    shapes = {name: site.shape for name, site in model.observation_sites.items()}
    _check_read(table, (*shapes, FRAME))
    data = columns_of(table.columns, shapes, path, others=table.unread)
    try:
        model.observe(data)
    except ValueError as error:
        raise InputError(str(error), file=path) from error
    return Series(data, inputs, frames_of(table.columns, path))
