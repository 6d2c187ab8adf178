"""From the columns of a table to a model's data and inputs.

A site without a shape is the column of its name; the entries of one of shape (k,) are the columns ``y[0]``, ``y[1]``, ...,
named as its coordinates are, or one variable ``y`` (T, k) of a file that has such.

>>> columns_of({"y[0]": np.zeros(3), "y[1]": np.ones(3)}, {"y": (2,)}, "data.csv")["y"].shape
(3, 2)
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from poseppl.errors import FilePath, InputError, brief

FRAME = "frame"
"""The column of frame numbers."""


def columns_of(
    table: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]], path: FilePath, others: Iterable[str] = ()
) -> dict[str, NDArray[Any]]:
    """Arrays (T, ...) by name, of such shapes.

    Args:
        table: Columns by name.
        shapes: Shapes of a frame's values by name.
        path: The file, for messages.
        others: Columns that the file has besides, for messages.

    Raises:
        InputError: A column is missing, or a variable has another shape.
    """
    return {name: _array(table, name, shape, path, others) for name, shape in shapes.items()}


def _array(
    table: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...], path: FilePath, others: Iterable[str]
) -> NDArray[Any]:
    if name in table:
        if table[name].shape[1:] != shape:
            entries = f"; in a CSV file the columns {name}[0], ..." if shape else ""
            expected = f"{shape} in each frame{entries}"
            raise InputError(f"{table[name].shape[1:]} in each frame", file=path, field=name, expected=expected)
        return table[name]
    names = [f"{name}[{','.join(map(str, index))}]" for index in itertools.product(*map(range, shape))] if shape else [name]
    missing = [each for each in names if each not in table]
    if missing:
        expected = f"{', '.join(names[:6])}; it has {', '.join([*table, *others])}"
        raise InputError(f"no column {brief(missing[0])}", file=path, expected=expected)
    return np.stack([table[each] for each in names], -1).reshape(-1, *shape)


def frames_of(table: Mapping[str, NDArray[Any]], path: FilePath) -> NDArray[np.int64] | None:
    """Frame numbers (T,), where the table has them.

    Raises:
        InputError: They are no whole numbers, or do not increase.
    """
    if FRAME not in table:
        return None
    numbers = table[FRAME]
    before = np.concatenate([[-np.inf], numbers[:-1]])
    wrong = np.flatnonzero((numbers != np.round(numbers)) | ~(numbers > before))
    if len(wrong):
        row = int(wrong[0])
        number = "no number" if np.isnan(numbers[row]) else f"{numbers[row]:g}"
        found = f"{number} in row {row}" + (f", after {before[row]:g}" if row else "")
        raise InputError(found, file=path, field=FRAME, expected="whole numbers that increase, rows counted from 0")
    return numbers.astype(np.int64)
