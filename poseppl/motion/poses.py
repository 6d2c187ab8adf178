"""A body's poses in a result: its skeleton, its projected points, and the error that its posterior expects."""

from __future__ import annotations

import numpy as np
import xarray as xr

from poseppl.arrays import Integers
from poseppl.diagnostics.selection import Array, some_draws
from poseppl.runs.contents import draws_of, variable


def edges(tree: xr.DataTree) -> Integers:
    """Pairs of markers between which the skeleton is drawn, (edge, 2); none if the result names none."""
    found = variable(tree, "body", "edges")
    return np.zeros((0, 2), np.int64) if found is None else found.astype(np.int64)


def segments(points: Array, pairs: Integers) -> Array:
    """Lay a skeleton out as one broken line.

    Args:
        points: (..., marker, k).
        pairs: (edge, 2).

    Returns:
        (..., 3 edges, k), each third point NaN.
    """
    ends = points[..., pairs, :].astype(np.float64)
    gap = np.full((*ends.shape[:-2], 1, ends.shape[-1]), np.nan)
    whole = np.concatenate([ends, gap], axis=-2)
    return whole.reshape(*points.shape[:-2], -1, points.shape[-1])


def mean_points(tree: xr.DataTree) -> Array | None:
    """Mean of the projected draws, (frame, camera, marker, xy): from the summary, else from the draws."""
    found = variable(tree, "summary", "points_mean")
    if found is not None:
        return found
    draws = draws_of(tree, "points")
    return None if draws is None else np.asarray(draws.mean(axis=(0, 1), dtype=np.float64))


def image_grows_down(tree: xr.DataTree, camera: int) -> bool:
    """Whether y of an image points down, as in pixels; the camera of Choo and Fleet (negative focal length in y) has it up."""
    focal = variable(tree, "camera", "focal")
    return focal is not None and bool(np.asarray(focal).reshape(len(focal), -1)[camera, -1] > 0)


def expected_error(tree: xr.DataTree, most: int = 200) -> Array | None:
    """The error that the posterior itself expects: distance of its draws from its mean, averaged over the markers.

    Args:
        tree: The result.
        most: How many draws are used.

    Returns:
        (3, frame): the 5 %, 50 % and 95 % quantiles over draws, in mm; None without markers.
    """
    draws, mean = some_draws(tree, "markers", most), variable(tree, "summary", "markers_mean")
    if draws is None or mean is None:
        return None
    distance = np.linalg.norm(draws - mean, axis=-1).mean(axis=-1)
    return np.asarray(np.quantile(distance, [0.05, 0.5, 0.95], axis=0))
