"""A result's intervals against a reference: draws of another filter of the same model on the same data.

Where the reference is right, as a particle filter of many effective particles is in few dimensions, the share of its draws in
the result's 90 % intervals is the coverage to expect of these data, and needs no truth. It tells what predictions of the data
do not: an error in what the data hardly depend on, such as a distance by bearings or a sign.
"""

from __future__ import annotations

import xarray as xr

from poseppl.diagnostics.batches import Interval, mean_interval
from poseppl.errors import InputError
from poseppl.runs.contents import flat_draws, group_of


def reference_coverage(result: xr.DataTree, reference: xr.DataTree) -> Interval:
    """Share of a reference's draws in the 90 % intervals of a result, over frames and coordinates that are not known exactly.

    Args:
        result: A filter's result.
        reference: Another one's, of the same model and data.

    Returns:
        The share, its standard error by batches of frames; 0.9 is right.

    Raises:
        InputError: The results are of other frames or coordinates.
    """
    quantiles = group_of(result, "summary")["state_quantile"]
    low, high = (quantiles.sel(quantile=level, method="nearest").values for level in (0.05, 0.95))
    draws = flat_draws(reference).transpose("chain", "draw", "frame", "dof").values
    if draws.shape[2:] != low.shape:
        raise InputError(
            f"frames and coordinates {draws.shape[2:]}", field="reference", expected=f"those of the result, {low.shape}"
        )
    free = (high > low).any(0)
    return mean_interval(((low <= draws) & (draws <= high))[..., free].mean((0, 1, 3)))
