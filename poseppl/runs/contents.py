"""Contents of a result as plain arrays and names, where it may lack a group, a variable or a dimension.

>>> tree = xr.DataTree.from_dict({FLAT: xr.Dataset({"state": ("state_dim", np.zeros(2))}, coords={"state_dim": ["x", "y"]})})
>>> names_of(tree, "state_dim"), variable(tree, "truth", "state"), arrays_of(tree, "inputs")
(['x', 'y'], None, {})
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Integers
from poseppl.program import CompiledModel
from poseppl.runs.labels import Names

FLAT = "unconstrained_posterior"
"""The group of the draws of the flat state, ``state`` (chain, draw, frame, state_dim), as ArviZ calls it."""

HISTORY = "filter_history"
"""The group of what smoothers start from, see :mod:`poseppl.runs.filter_history`."""


def group_of(tree: xr.DataTree, name: str) -> xr.Dataset:
    """A group of a result, empty where it has none of this name."""
    group = tree.children.get(name)
    return xr.Dataset() if group is None else group.to_dataset()


def arrays_of(tree: xr.DataTree, group: str) -> dict[str, NDArray[Any]]:
    """The variables of a group by name, none where the result has no such group."""
    data = group_of(tree, group)
    return {str(name): each.values for name, each in data.variables.items() if name not in data.coords}


def variable(tree: xr.DataTree, group: str, name: str) -> NDArray[Any] | None:
    """Values of a variable, None where the result has no such group or variable."""
    data = group_of(tree, group)
    return np.asarray(data.variables[name].values) if name in data.variables else None


def flat_draws(tree: xr.DataTree) -> xr.DataArray:
    """Draws of the flat state, (chain, draw, frame, state_dim)."""
    return tree[FLAT].dataset["state"]


def draws_of(tree: xr.DataTree, name: str) -> NDArray[Any] | None:
    """Draws (chain, draw, frame, ...) of the flat ``state``, of a site or an extra; None where the result has none."""
    return variable(tree, FLAT if name == "state" else "posterior", name)


def names_of(tree: xr.DataTree, dim: str, group: str | None = None) -> list[str]:
    """Names along a dimension such as ``state_dim``, of one group or of the first that has them; none without."""
    groups = (group_of(tree, name) for name in ([group] if group else tree.children))
    return next(([str(name) for name in data[dim].values] for data in groups if dim in data.coords), [])


def names_of_result(tree: xr.DataTree) -> Names:
    """The names that a result was built with, as far as it has variables of them."""
    drawn, seen, summary = (group_of(tree, name) for name in ("posterior", "observed_data", "summary"))
    leading = ("chain", "draw", "frame")
    variables = [(name, each) for data in (seen, drawn) for name, each in data.variables.items() if name not in data.coords]
    dims = {str(name): tuple(str(dim) for dim in each.dims if dim not in leading) for name, each in variables}
    finite = [str(name).removesuffix("_probability") for name in summary if str(name).endswith("_probability")]
    values = {name: summary[f"{name}_value"].values.tolist() for name in finite if f"{name}_value" in summary.coords}
    along = {dim: names_of(tree, dim) for own in dims.values() for dim in own if dim != "state_dim"}
    return Names(names_of(tree, "state_dim"), values, along, dims)


def frame_numbers(tree: xr.DataTree) -> Integers:
    """Frame numbers of a result, (frame,)."""
    return np.asarray(tree["posterior"].dataset["frame"].values, np.int64)


def nearest_turn(tree: xr.DataTree, values: NDArray[Any], centre: NDArray[Any]) -> NDArray[Any]:
    """Flat states (..., frame, state_dim), whose angles are counted in the turn about a centre (frame, state_dim)."""
    angles = np.isin(names_of(tree, "state_dim"), _angles(tree))
    turn = 2 * np.pi
    return np.where(angles, values + turn * np.round((centre - values) / turn), values) if angles.any() else values


def _angles(tree: xr.DataTree) -> list[str]:
    """Names of the coordinates that are angles; none where the attribute is not such a list."""
    try:
        known = json.loads(tree.attrs.get("circular", "[]"))
    except (TypeError, ValueError):
        return []
    return [name for name in known if isinstance(name, str)] if isinstance(known, list) else []


def check_one_series(tree: xr.DataTree) -> None:
    """Refuse a result of many series.

    Raises:
        ValueError: It is one.
    """
    if "series" in group_of(tree, FLAT).dims:
        raise ValueError("The result is one of many series. Take one of them, poseppl.one_series(result, name).")


def check_coordinates(tree: xr.DataTree, model: CompiledModel) -> None:
    """Refuse a result that is not one of a model.

    Raises:
        ValueError: Its coordinates are others, or it is one of many series.
    """
    check_one_series(tree)
    names = tuple(names_of(tree, "state_dim"))
    if names != model.coordinate_names:
        raise ValueError(
            f"The result is one of the coordinates {list(names)}, the model of {list(model.coordinate_names)}. Expected the "
            "same model."
        )
