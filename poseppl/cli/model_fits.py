"""Fits of a user's own model for `poseppl fit`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

from poseppl.checks import RangeError
from poseppl.cli.checks import rows_of_text
from poseppl.cli.model_runs import compile_programs, load_programs, read_series, series_of
from poseppl.cli.options import as_option
from poseppl.errors import Argument, InputError, SettingError, UnsuitableModelError, brief
from poseppl.files.csv_fields import decimal_number
from poseppl.filters.base import Filter
from poseppl.filters.suitability import takes
from poseppl.fitting.fit import OWN_FILTER, fit
from poseppl.fitting.results import findings_of_fit
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl.program.parameters import parameter_bijector
from poseppl.runs.algorithms import FILTERS, Algorithms
from poseppl.runs.fitted_params import ESTIMATE
from poseppl.runs.results import provenance
from poseppl.runs.settings import arguments_of

HEAD = ("parameter", "estimate", "SE or SD", "5 %", "95 %")
"""Columns of the table of estimates."""
_METHODS = Algorithms("method", "poseppl.fitting")
_STEPS = {"svi": ("num_steps",), "iterated-filtering": ("num_passes",), "smc2": ()}
"""Settings whose sum is the number of steps; of chains those of warm-up and draws."""
_EXACT, _PARTICLES = ("hidden-markov", "kalman"), ("pmmh", "smc2")


class _Steps:
    """Passes progress on; notes are kept, for findings are printed at the end, with options by their names."""

    def __init__(self, progress: Any) -> None:
        self.advance, self.notes = progress.advance, list[str]()

    def note(self, message: str) -> None:
        """Keep it."""
        self.notes.append(message)


def fitted(name: str, path: str, options: Mapping[str, Any], progress: Any) -> xr.DataTree:
    """Fit the parameters of a model to the data of a file.

    Args:
        name: The model, ``FILE.py[:NAME]``.
        path: The table.
        options: Those of the command.
        progress: Reports the fit's progress.

    Raises:
        InputError: The model, the data or a setting cannot be used.
    """
    method, settings = options["method"], _METHODS[options["method"]].complete(options["settings"])
    progress.stage("reading")
    table, inputs = read_series(path, tuple(options["inputs"]), rows_of_text(options["frames"]))
    model = compile_programs(_with_parameters(load_programs(name)), inputs)
    series = series_of(model, table, inputs, path)
    for error in table.misspelt:
        progress.note(f"{error}; nothing uses that column, which is left out")
    filter_name = _filter_name(model, method, options["filter_name"])
    build = None if filter_name is None else _builder(filter_name, options["filter_settings"])
    start = _start(model, options["start"]) if options["start"] else None
    attrs = {"input": Path(path).name, "model": name, "settings": settings, "seed": options["seed"]}
    attrs |= {"filter": filter_name, "filter settings": options["filter_settings"]} if filter_name else {}
    steps = _Steps(progress)
    known: dict[str, Any] = {"method": method, "start": start, "frames": series.frames, "fill_gaps": options["fill_gaps"]}
    progress.stage("fitting", total=_num_steps(method, settings, len(next(iter(series.data.values())))))
    try:
        key = jax.random.key(options["seed"])
        tree = fit(model, series.data, build, key, inputs, attrs=attrs, progress=steps, **known, **settings)
    except UnsuitableModelError as error:
        expected = "another filter, or --method pmmh or iterated-filtering"
        raise InputError(str(error), field=f"--filter {filter_name}", expected=expected) from error
    except RangeError as error:
        raise SettingError(error.setting, error.value, f"expected {error.expected}") from error
    except ValueError as error:
        raise InputError(str(error), file=path) from error
    reported = {str(each) for each in findings_of_fit(tree)}
    for note in steps.notes:
        if note not in reported:
            progress.note(note)
    return tree


def _with_parameters(programs: StateSpaceModel) -> StateSpaceModel:
    """The programs, if there is something to estimate."""
    if programs.parameters is None:
        expected = "StateSpaceModel(..., parameters=parameters), a program that samples each of them from a prior"
        raise InputError("its programs have no parameters to estimate", field="MODEL", expected=expected)
    return programs


def _filter_name(model: CompiledModel, method: str, given: str | None) -> str | None:
    """The filter: the one given, or the one that suits method and model.

    Raises:
        InputError: No filter with an exact likelihood takes the model.
    """
    if given or method in OWN_FILTER:
        return given
    if method in _PARTICLES:
        return "particle"
    example = model.with_params(model.sample_parameters(jax.random.key(0)))
    found = next((name for name in _EXACT if takes(example, FILTERS[name].builder)), None)
    if found is None:
        problem = f"no filter with an exact likelihood takes the model, as method {method} needs by itself"
        expected = "one that takes it, such as ensemble-kalman; or --method pmmh, smc2, particle-gibbs or iterated-filtering"
        raise InputError(problem, field="--filter", expected=expected)
    return found


def _builder(name: str, given: Mapping[str, str]) -> Callable[[CompiledModel], Filter]:
    """The filter's builder with its settings."""
    algorithm = FILTERS[name]
    algorithm.check(given)
    return partial(algorithm.builder, **arguments_of(algorithm.builder, algorithm.complete(given)))


def _start(model: CompiledModel, given: Mapping[str, str]) -> dict[str, Any]:
    """Parameters by name, arrays from the words of their entries.

    Raises:
        InputError: A word is no number, or an entry is missing or unknown.
    """
    sites = parameter_bijector(model).sites
    start = {name: np.full(site.shape, np.nan) for name, site in sites.items()}
    entries = {
        f"{name}[{','.join(map(str, index))}]" if index else name: (name, index)
        for name, values in start.items()
        for index in np.ndindex(values.shape)
    }
    if set(given) != set(entries):
        raise InputError(f"{', '.join(given)}", field="--start", expected=f"a value of each of {', '.join(entries)}")
    for entry, (name, index) in entries.items():
        value = decimal_number(given[entry])
        if value is None:
            raise InputError(f"{entry}={brief(given[entry])}", field="--start", expected="a number")
        start[name][index] = value
    return start


def _num_steps(method: str, settings: Mapping[str, Any], num_frames: int) -> int | None:
    """How many steps the fit reports; None where that depends on the search."""
    if method == "smc2":
        return num_frames
    names = _STEPS.get(method, ("num_warmup", "num_draws"))
    return sum(settings[name] for name in names) if set(names) <= set(settings) else None


def _worded(argument: Argument) -> str:
    """An argument of a fit as an option: what is no option of the command is a setting of the method."""
    options = ("start", "method", "fill_gaps", "filter")
    return as_option(argument if argument.name in options else argument._replace(setting=True))


def worded_findings(tree: xr.DataTree) -> list[tuple[str, str]]:
    """Severities and texts of a fit's findings, errors first."""
    return [(each.severity, each.worded(_worded)) for each in findings_of_fit(tree)]


def _estimates(tree: xr.DataTree) -> dict[str, tuple[float, ...]]:
    """Estimate, standard error, and both ends of the central 90 % of the draws, of each entry of each parameter."""
    estimate, draws = tree[ESTIMATE].dataset, tree["posterior"].dataset
    found = {}
    for name in map(str, draws.data_vars):
        ends = np.quantile(draws[name].values, (0.05, 0.95), axis=(0, 1))
        columns = np.stack([estimate[name].values, estimate[f"{name}_se"].values, *ends], -1)
        for index in np.ndindex(columns.shape[:-1]):
            found[name + (f"[{','.join(map(str, index))}]" if index else "")] = tuple(map(float, columns[index]))
    return found


def rows_of(tree: xr.DataTree) -> list[tuple[str, ...]]:
    """Rows of the table of estimates."""
    return [(name, *(f"{value:.4g}" for value in values)) for name, values in _estimates(tree).items()]


def described(tree: xr.DataTree, target: Path) -> dict[str, Any]:
    """The results of a fit, as JSON can hold them."""
    known = provenance(tree)
    shown: dict[str, Any] = {name: known[name] for name in ("input", "model", "method", "filter") if name in known}
    shown["frames"] = int(tree["observed_data"].sizes["frame"])
    shown |= {name.replace("_", " "): _finite(known[name]) for name in ("log_likelihood", "log_evidence") if name in known}
    shown |= {"seconds": round(known["wall_seconds"], 3), "result": str(target)}
    return {
        **shown,
        "parameters": {
            name: dict(zip(HEAD[1:], map(_finite, values), strict=True)) for name, values in _estimates(tree).items()
        },
        "verdicts": [{"severity": severity, "text": text} for severity, text in worded_findings(tree)],
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
