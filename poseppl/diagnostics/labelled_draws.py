"""Functions of draws that take ArviZ's data, too: arrays with dimensions ``chain`` and ``draw``, alone or in a result.

>>> @over_draws
... def mean(draws):
...     return draws.mean(axis=(0, 1))
>>> mean(xr.DataArray(np.ones((3, 2, 5)), dims=("frame", "chain", "draw"))).dims
('frame',)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Protocol, overload

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from poseppl.arrays import Floats


class OverDraws(Protocol):
    """A function of draws: of an array (chain, draw, ...), or of xarray's data by the names of the dimensions."""

    @overload
    def __call__(self, draws: xr.DataTree | xr.Dataset) -> xr.Dataset: ...
    @overload
    def __call__(self, draws: xr.DataArray) -> xr.DataArray: ...
    @overload
    def __call__(self, draws: ArrayLike) -> Floats: ...


def over_draws(function: Callable[[ArrayLike], Floats]) -> OverDraws:
    """Let a function of an array (chain, draw, ...) take ArviZ's data.

    Args:
        function: From (chain, draw, ...) to (...).

    Returns:
        The function; of a DataTree it takes the group ``posterior``, of a Dataset the variables that have draws.
    """

    @wraps(function)
    def labelled(draws: Any) -> Any:
        if isinstance(draws, xr.DataTree):
            return labelled(draws["posterior"].dataset)
        if isinstance(draws, xr.Dataset):
            return xr.Dataset({name: labelled(each) for name, each in draws.items() if {"chain", "draw"} <= set(each.dims)})
        if isinstance(draws, xr.DataArray):
            return xr.apply_ufunc(
                lambda values: function(np.moveaxis(values, (-2, -1), (0, 1))), draws, input_core_dims=[["chain", "draw"]]
            )
        return function(draws)

    return labelled
