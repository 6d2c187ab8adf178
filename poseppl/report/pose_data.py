"""The data behind the interactive poses of the report, some frames and draws, rounded so that a page stays small."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import (
    Array,
    edges,
    evenly,
    frame_numbers,
    image_grows_down,
    mean_points,
    some_draws,
    variable,
)

MAX_FRAMES = 120
MAX_SAMPLES = 20
_FIGURES = 4


def pose_data(tree: xr.DataTree) -> dict[str, Any] | None:
    """Collect what the slider of the report shows.

    Args:
        tree: The result.

    Returns:
        Plain lists, ready for JSON: ``frames``, ``edges``, ``markers``, ``space`` and ``image`` (either may be None), where
        points are in mm and in image units; None if the result has neither markers nor points.
    """
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_FRAMES)
    space, image = _space(tree, chosen), _image(tree, chosen)
    if space is None and image is None:
        return None
    return {
        "frames": frame_numbers(tree)[chosen].tolist(),
        "edges": edges(tree).tolist(),
        "markers": [str(name) for name in tree["posterior"].dataset["marker"].values],
        "space": space,
        "image": image,
    }


def _space(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = variable(tree, "summary", "markers_mean"), some_draws(tree, "markers", MAX_SAMPLES)
    if mean is None or draws is None:
        return None
    mean, draws, truth = mean[chosen], draws[:, chosen], variable(tree, "truth", "markers")
    centre = (mean.min(axis=1) + mean.max(axis=1)) / 2
    reach = np.nanquantile(np.abs(draws - centre[:, None]), 0.995) if np.isfinite(draws).any() else 1000.0
    return {
        "mean": _rounded(mean, 0),
        "draws": _rounded(np.moveaxis(draws, 1, 0), 0),
        "truth": None if truth is None else _rounded(truth[chosen], 0),
        "centre": _rounded(centre, 0),
        "reach": float(round(1.08 * reach + 50)),
    }


def _image(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = mean_points(tree), some_draws(tree, "points", MAX_SAMPLES)
    if mean is None or draws is None:
        return None
    mean, draws, seen = mean[chosen], draws[:, chosen], variable(tree, "observed_data", "points")
    shown = mean if seen is None else np.where(np.isfinite(seen[chosen]), seen[chosen], mean)
    low, high = np.minimum(mean, shown).min(axis=2), np.maximum(mean, shown).max(axis=2)
    spans = np.where(np.isfinite(high - low), high - low, 0.0).max(axis=2)
    reach = 0.62 * np.quantile(spans, 0.95, axis=0)
    reach = np.where(reach > 0, reach, 1.0)
    decimals = max(0, int(np.ceil(_FIGURES - 1 - np.log10(reach.min()))))
    return {
        "cameras": [str(name) for name in tree["posterior"].dataset["camera"].values],
        "mean": _rounded(mean, decimals),
        "draws": _rounded(np.moveaxis(draws, 1, 0), decimals),
        "observed": None if seen is None else _rounded(seen[chosen], decimals),
        "centre": _rounded((low + high) / 2, decimals),
        "reach": reach.tolist(),
        "down": [image_grows_down(tree, camera) for camera in range(mean.shape[1])],
    }


def _rounded(values: Array, decimals: int) -> Any:
    """Nested lists with None for what is not finite: JSON knows no NaN."""
    wide = np.round(values.astype(np.float64), decimals)
    plain = wide.astype(object)
    if decimals == 0:
        plain = np.where(np.isfinite(wide), wide, 0).astype(np.int64).astype(object)
    plain[~np.isfinite(wide)] = None
    return plain.tolist()
