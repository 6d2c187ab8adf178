"""Poses as the report's slider and the pictures show them: some frames and draws, and windows around them."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from poseppl.diagnostics.selection import Array, edges, evenly, image_grows_down, mean_points, some_draws
from poseppl.report.room import room_data
from poseppl.runs.contents import draws_of, frame_numbers, names_of, variable

MAX_FRAMES = 120
MAX_SAMPLES, MIN_SAMPLES = 20, 4
MAX_VALUES = 240_000
"""Of the draws in space, and of those in the images: more frames, cameras or markers are shown by fewer draws."""
FARTHEST = 20.0
"""Draws farther from the middle than this many times what is shown are drawn there."""


def pose_data(tree: xr.DataTree, frames: Array | None = None) -> dict[str, Any] | None:
    """Collect what is shown of the poses.

    Args:
        tree: The result.
        frames: Indices of frames; evenly spaced ones if None.

    Returns:
        ``frames``, ``edges``, ``markers``, and ``space`` in mm and ``image`` in image units (either may be None), arrays with a
        frame first; None if the result has neither markers nor points.
    """
    chosen = evenly(tree["posterior"].sizes["frame"], MAX_FRAMES) if frames is None else frames
    space, image = _space(tree, chosen), _image(tree, chosen)
    if space is None and image is None:
        return None
    shared = {"frames": frame_numbers(tree)[chosen], "edges": edges(tree), "markers": names_of(tree, "marker")}
    return shared | {"space": space, "image": image}


def _space(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = (
        variable(tree, "summary", "markers_mean"),
        some_draws(tree, "markers", _affordable(tree, "markers", len(chosen))),
    )
    if mean is None or draws is None:
        return None
    mean, draws, truth = mean[chosen], np.moveaxis(draws[:, chosen], 1, 0), variable(tree, "truth", "markers")
    centre = (mean.min(axis=1) + mean.max(axis=1)) / 2
    reach = np.nanquantile(np.abs(draws - centre[:, None, None]), 0.995) if np.isfinite(draws).any() else 1000.0
    draws = _within(draws, centre[:, None, None], reach)
    found = {"mean": mean, "draws": draws, "truth": None if truth is None else truth[chosen]}
    shown = {"centre": centre, "reach": float(f"{1.1 * reach:.3g}")}
    return found | shown | room_data(tree, chosen)


def _image(tree: xr.DataTree, chosen: Array) -> dict[str, Any] | None:
    mean, draws = mean_points(tree), some_draws(tree, "points", _affordable(tree, "points", len(chosen)))
    if mean is None or draws is None:
        return None
    mean, draws, seen = mean[chosen], np.moveaxis(draws[:, chosen], 1, 0), variable(tree, "observed_data", "points")
    shown = mean if seen is None else np.where(np.isfinite(seen[chosen]), seen[chosen], mean)
    low, high = np.minimum(mean, shown).min(axis=2), np.maximum(mean, shown).max(axis=2)
    spans = np.where(np.isfinite(high - low), high - low, 0.0).max(axis=2)
    reach = 0.62 * np.quantile(spans, 0.95, axis=0)
    centre, reach = (low + high) / 2, np.where(reach > 0, reach, 1.0)
    return {
        "cameras": names_of(tree, "camera"),
        "mean": mean,
        "draws": _within(draws, centre[:, None, :, None], reach[:, None, None]),
        "observed": None if seen is None else seen[chosen],
        "centre": centre,
        "reach": reach,
        "down": [image_grows_down(tree, camera) for camera in range(mean.shape[1])],
    }


def _affordable(tree: xr.DataTree, name: str, frames: int) -> int:
    """How many draws of a variable are shown."""
    values = draws_of(tree, name)
    each = 1 if values is None else frames * int(np.prod(values.shape[3:]))
    return max(MIN_SAMPLES, min(MAX_SAMPLES, MAX_VALUES // each))


def _within(draws: Array, centre: Array, reach: Any) -> Array:
    """Draws, those that are far away drawn nearer, so that the others are shown as finely as the picture needs."""
    return np.clip(draws, centre - FARTHEST * reach, centre + FARTHEST * reach)
