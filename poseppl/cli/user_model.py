"""A user's own model and data on the command line: the programs that a file defines, and a table's columns as their data."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import InputError
from poseppl.files.table_reading import read_table
from poseppl.files.user_code import import_named
from poseppl.program import CompiledModel, StateSpaceModel
from poseppl.runs.columns import columns_of, frames_of

_EXPECTED = "a StateSpaceModel, or a function without arguments that returns one, such as model = StateSpaceModel(...)"


class Series(NamedTuple):
    """What a file holds of one series: data and inputs by name, (T, ...), and frame numbers (T,) or None."""

    data: dict[str, NDArray[Any]]
    inputs: dict[str, NDArray[Any]] | None
    frames: NDArray[np.int64] | None


def source_digest(name: str) -> str:
    """Path and hash of the file of ``FILE.py[:NAME]``; nothing for a module of a package."""
    path = Path(name.partition(":")[0])
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
        raise InputError(f"{place} has no {attribute!r}", field="MODEL", expected=", ".join(known) or _EXPECTED)
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


def compile_programs(programs: StateSpaceModel, inputs: Any, params: Mapping[str, float] | None) -> CompiledModel:
    """Compile them, for the inputs (T, ...) that a table has.

    Raises:
        InputError: They are no state-space model, or want parameters.
    """
    first = None if inputs is None else {name: values[0] for name, values in inputs.items()}
    try:
        model = programs.compile(first, None if params is None else {name: np.float32(value) for name, value in params.items()})
    except ValueError as error:
        raise InputError(str(error), field="MODEL") from error
    if model.unbound:
        raise InputError("its programs have parameters", field="MODEL", expected="--param NAME=VALUE for each")
    return model


def read_series(path: str | Path, input_names: tuple[str, ...], rows: slice) -> tuple[dict[str, NDArray[Any]], Any]:
    """The columns of a table, some of its rows, and the inputs among them by name; None where no input is named.

    Raises:
        InputError: The table cannot be read, has no such rows, or lacks an input.
    """
    table = {name: values[rows] for name, values in read_table(path).items()}
    if not table or not len(next(iter(table.values()))):
        raise InputError("there is no such row", file=path, field="--frames", expected="rows of the table, counted from 0")
    missing = [name for name in input_names if name not in table]
    if missing:
        expected = f"some of {', '.join(table)}"
        raise InputError(f"no column {missing[0]!r}", file=path, field="--inputs", expected=expected)
    return table, {name: np.asarray(table[name], np.float32) for name in input_names} or None


def series_of(model: CompiledModel, table: dict[str, NDArray[Any]], inputs: Any, path: str | Path) -> Series:
    """Data, inputs and frame numbers for a model.

    Raises:
        InputError: A column is missing, or the data do not fit the model.
    """
    shapes = {name: site.shape for name, site in model.observation_sites.items()}
    data = columns_of(table, shapes, path)
    try:
        model.observe(data)
    except ValueError as error:
        raise InputError(str(error), file=path) from error
    return Series(data, inputs, frames_of(table, path))
