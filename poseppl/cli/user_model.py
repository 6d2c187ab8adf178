"""A user's own model and data on the command line: the programs that a file defines, and a table's columns as their data."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError, brief
from poseppl.files.table_reading import NumberTable, read_table
from poseppl.files.user_code import file_of_module, import_named
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl.runs.columns import FRAME, columns_of, frames_of

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
