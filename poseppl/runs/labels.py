"""Names of the dimensions of a result's arrays, and their coordinates.

Axes of a variable that :class:`Names` describes have the dimensions given there, ``state`` has ``state_dim``; those of any
other are called ``NAME_dim_0``, ``NAME_dim_1``, ..., as ArviZ calls them.

>>> known = coordinates(Names(("level",)), (1, 2, 3))
>>> labelled({"state": np.zeros((1, 2, 3, 1)), "rate": np.ones((1, 2, 3, 4))}, ("chain", "draw", "frame"), known)["rate"].dims
('chain', 'draw', 'frame', 'rate_dim_0')
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.runs.datasets import dataset_of

QUANTILES = (0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95)
"""The quantiles of ``summary``: the central 90, 80 and 50 % intervals and the median."""

Dims = Mapping[str, tuple[str, ...]]
_CACHED_BYTES = 2**18
"""Size of coordinates up to which they are kept for later results."""
_NONE: Mapping[str, Any] = MappingProxyType({})


class Names(NamedTuple):
    """Names of a result's coordinates and dimensions.

    Attributes:
        state_dim: Names of the flat state's coordinates.
        values: The values that a site of finitely many takes, by the site's name.
        along: Names along further dimensions; a dimension without names has no coordinate.
        dims: The last dimensions of variables, by the variable's name.
    """

    state_dim: Sequence[str]
    values: Mapping[str, Sequence[int]] = _NONE
    along: Mapping[str, Sequence[str]] = _NONE
    dims: Dims = _NONE


def coordinates(
    names: Names, shape: tuple[int, ...], frames: ArrayLike | None = None, quantiles: Sequence[float] = QUANTILES
) -> xr.Coordinates:
    """Coordinates of all dimensions, of draws that begin with (chain, draw, frame)."""
    values: dict[str, NDArray[Any]] = {
        "chain": np.arange(shape[0]),
        "draw": np.arange(shape[1]),
        "frame": np.arange(shape[2]) if frames is None else np.asarray(frames),
        "state_dim": np.array(names.state_dim, dtype=str),
        **{name: np.array(given, dtype=str) for name, given in names.along.items() if len(given)},
        **{f"{name}_value": np.array(given) for name, given in names.values.items()},
        "quantile": np.array(quantiles, float),
    }
    if sum(each.nbytes for each in values.values()) > _CACHED_BYTES or any(each.dtype.hasobject for each in values.values()):
        return xr.Coordinates(values)
    return _indexed(tuple((dim, each.dtype, each.shape, each.tobytes()) for dim, each in values.items()))


@lru_cache(maxsize=16)
def _indexed(values: tuple[tuple[str, np.dtype[Any], tuple[int, ...], bytes], ...]) -> xr.Coordinates:
    """Coordinates with their indexes, which several results share: their arrays cannot be written to."""
    return xr.Coordinates({dim: np.ndarray(shape, dtype, data) for dim, dtype, shape, data in values})


def _dims_of(name: str, number: int, dims: Dims) -> tuple[str, ...]:
    """Names of the last dimensions of a variable."""
    own = dims.get(name, ("state_dim",) if name == "state" else ())
    return own if len(own) == number else tuple(f"{name}_dim_{i}" for i in range(number))


def labelled(
    variables: Mapping[str, ArrayLike], leading: tuple[str, ...], known: xr.Coordinates, dims: Dims = _NONE
) -> xr.Dataset:
    """Name the axes of each variable: the leading ones, then those of its name, else ``NAME_dim_0``, ..."""
    data: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
    for name, given in variables.items():
        values = np.asarray(given)
        rest = values.ndim - len(leading)
        data[name] = (leading + _dims_of(name, rest, dims), values)
    return checked(data, known)


def labelled_summary(
    statistics: Mapping[str, ArrayLike], leading: tuple[str, ...], known: xr.Coordinates, dims: Dims = _NONE
) -> xr.Dataset:
    """Name the axes of summaries: ``NAME_mean``, ``NAME_quantile`` (quantile, ...), ``NAME_probability`` (..., value)."""
    data: dict[str, tuple[tuple[str, ...], NDArray[Any]]] = {}
    for name, values in statistics.items():
        site, _, statistic = name.rpartition("_")
        middle = ("quantile",) if statistic == "quantile" else ()
        array = np.asarray(values)
        last = (f"{site}_value",) if statistic == "probability" else ()
        own = _dims_of(site, array.ndim - len(leading) - len(middle) - len(last), dims)
        data[name] = ((*leading, *middle, *own, *last), array)
    return checked(data, known)


def checked(data: Mapping[str, tuple[tuple[str, ...], NDArray[Any]]], known: xr.Coordinates) -> xr.Dataset:
    """A dataset of variables with named dimensions.

    Raises:
        ValueError: A shape does not agree with the coordinates.
    """
    sizes = {str(dim): each.size for dim, each in known.variables.items()}
    for name, (dims, values) in data.items():
        wanted = tuple(sizes.get(dim, size) for dim, size in zip(dims, values.shape, strict=False))
        if values.ndim != len(dims) or values.shape != wanted:
            raise ValueError(f"{name} has shape {values.shape}; expected {dims} of {wanted}")
    return dataset_of({name: xr.Variable(dims, values, fastpath=True) for name, (dims, values) in data.items()}, known)
