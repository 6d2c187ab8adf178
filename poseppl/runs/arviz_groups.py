"""A result as the installed ArviZ takes it: a DataTree from version 1 on, its InferenceData before.

    arviz.loo(to_arviz(add_predictive(result, model, rng_key)))

ArviZ does not support missing data. For a site with missing data, ``observed_data``, ``posterior_predictive`` and
``log_likelihood`` contain the observed events, in one dimension ``NAME_seen``, with their frames as ``NAME_frame``. The result
itself keeps its shape and its NaN.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from poseppl.runs.contents import FLAT, group_of

_GROUPS = ("posterior", FLAT, "sample_stats", "observed_data", "posterior_predictive", "log_likelihood", "predictions")
"""ArviZ's groups that a result may have."""


def to_arviz(result: xr.DataTree) -> Any:
    """Convert a result to what the functions of the installed ArviZ take.

    Args:
        result: A result, or a forecast; not modified.

    Returns:
        A DataTree, or before version 1 of ArviZ an ``arviz.InferenceData``.
    """
    groups = {name: result[name].to_dataset() for name in _GROUPS if name in result.children}
    for name, mask in _partly_seen(result).items():
        for group in ("observed_data", "posterior_predictive", "log_likelihood"):
            if name in groups.get(group, {}):
                groups[group] = _only_seen(groups[group], name, mask)
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = dict(result.attrs)
    if int(version("arviz").partition(".")[0]) >= 1:
        return tree
    before: Any = import_module("arviz")
    return before.from_datatree(tree)


def _partly_seen(result: xr.DataTree) -> dict[str, xr.DataArray]:
    """Which events of a site were seen, (frame, ...), of sites of which some were not."""
    terms, data = group_of(result, "log_likelihood"), group_of(result, "observed_data")
    masks: dict[str, xr.DataArray] = {}
    for name, values in data.items():
        seen: xr.DataArray = values.notnull()
        event = [dim for dim in values.dims if name in terms and dim not in terms[name].dims]
        mask = seen.all(event)
        if not mask.all():
            masks[str(name)] = mask
    return masks


def _only_seen(group: xr.Dataset, name: str, mask: xr.DataArray) -> xr.Dataset:
    """The group with the events of a site that were seen, one after the other."""
    whole = group[name].stack({f"{name}_seen": mask.dims}, create_index=False)
    chosen = whole.isel({f"{name}_seen": np.flatnonzero(mask.values)})
    frames = np.broadcast_to(mask["frame"].values.reshape(-1, *(1,) * (mask.ndim - 1)), mask.shape)[mask.values]
    chosen = chosen.assign_coords({f"{name}_frame": (f"{name}_seen", frames)})
    leading = [dim for dim in ("chain", "draw", f"{name}_seen") if dim in chosen.dims]
    return group.drop_vars(name).assign({name: chosen.transpose(*leading, ...)})
