"""Whether results are of the same data: the same frames, observed values and truth; without values the same coordinates.

>>> from poseppl.runs.results import Names, build_result
>>> first, second = (build_result(state=np.zeros((1, 4, frames, 1)), names=Names(("level",))) for frames in (3, 5))
>>> difference(data_of(first), data_of(second))
'frames 0-4, but frames 0-2'
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Integers
from poseppl.diagnostics.verdicts import frame_ranges
from poseppl.runs.contents import arrays_of, frame_numbers, group_of, names_of

_TOLERANCE = 1e-5
"""Tolerance, as a share of the largest observed value: above what a text file rounds off, far below any noise."""


class Data(NamedTuple):
    """Data that runs must share.

    Attributes:
        frames: Frame numbers (frame,).
        dofs: Names of the degrees of freedom.
        observed: The data by name, (frame, ...) each, NaN where missing.
        truth: The truth by name, (frame, ...) each; empty where it is not known.
        cameras: Names and calibration of the cameras, by name; empty where there are none.
    """

    frames: Integers
    dofs: tuple[str, ...]
    observed: dict[str, NDArray[Any]]
    truth: dict[str, NDArray[Any]]
    cameras: dict[str, NDArray[Any]]


def data_of(tree: xr.DataTree) -> Data:
    """Find the data of a result.

    Args:
        tree: The result.
    """
    cameras = {str(name): values.values for name, values in group_of(tree, "camera").variables.items()}
    observed, truth = (arrays_of(tree, group) for group in ("observed_data", "truth"))
    return Data(frame_numbers(tree), tuple(names_of(tree, "state_dim")), observed, truth, cameras)


def difference(first: Data, second: Data) -> str | None:
    """Say in what the second differs from the first.

    A truth that only one of them knows is no difference, and neither are other coordinates of models of the same observed
    values. Runs that saw one truth through other cameras are of the same data.

    Args:
        first: Data of one result.
        second: Data of another.

    Returns:
        "THIS, but THAT", this of the second and that of the first; None if they are the same.
    """
    return next(_differences(first, second), None)


def _differences(first: Data, second: Data) -> Iterator[str]:
    """Say in what they differ; what comes behind other frames is not to be read."""
    if second.dofs != first.dofs and not (first.observed and second.observed):
        yield _different_dofs(first.dofs, second.dofs)
    if not np.array_equal(first.frames, second.frames):
        yield f"{frame_ranges(second.frames.tolist())}, but {frame_ranges(first.frames.tolist())}"
    if not other_cameras(first, second):
        if set(first.observed) != set(second.observed):
            yield f"observed {_listed(second.observed)}, but {_listed(first.observed)}"
        for name, values in first.observed.items():
            yield from _different_values(f"observed {name}", values, second.observed[name], first.frames)
    of_coordinates = set() if second.dofs == first.dofs else {"state"}
    for name in (first.truth.keys() & second.truth.keys()) - of_coordinates:
        yield from _different_values(f"true {name}", first.truth[name], second.truth[name], first.frames)


def other_cameras(first: Data, second: Data) -> bool:
    """Whether two runs saw something whose truth both know through cameras that differ in number, name or calibration."""
    if not (first.cameras and second.cameras and first.truth.keys() & second.truth.keys()):
        return False
    names = first.cameras.keys() & second.cameras.keys()
    return not all(np.array_equal(first.cameras[name], second.cameras[name]) for name in names)


def _listed(names: dict[str, Any]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _different_dofs(first: tuple[str, ...], second: tuple[str, ...]) -> str:
    if len(first) != len(second):
        return f"{len(second)} coordinates, but {len(first)}"
    place = next(i for i, (one, other) in enumerate(zip(first, second, strict=True)) if one != other)
    return f"coordinate {second[place]!r}, but {first[place]!r}"


def _different_values(label: str, first: NDArray[Any], second: NDArray[Any], frames: Integers) -> Iterator[str]:
    if first.shape != second.shape:
        yield f"{label} of shape {second.shape}, but {first.shape}"
    elif first.dtype.kind not in "fiub" or second.dtype.kind not in "fiub":
        if not np.array_equal(first, second):
            yield f"other {label}, but the same name"
    else:
        one, other = np.asarray(first, np.float64), np.asarray(second, np.float64)
        scale = np.abs(one[np.isfinite(one)]).max(initial=0.0)
        same = np.isclose(other, one, rtol=0.0, atol=_TOLERANCE * scale, equal_nan=True)
        wrong = ~same.reshape(len(frames), -1).all(axis=1)
        if wrong.any():
            yield f"other {label} in {frame_ranges(frames[wrong].tolist())}, but the same frames"
