"""Selection of what is drawn of a result: which frames, which draws, which coordinates, as plain arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from poseppl.arrays import Integers
from poseppl.runs.contents import draws_of, frame_numbers, variable
from poseppl.runs.results import is_weighted, provenance

Array = NDArray[Any]


def evenly(count: int, most: int) -> Integers:
    """Choose at most ``most`` of ``count`` indices, evenly spaced, with the first and the last.

    Args:
        count: How many there are.
        most: How many are wanted.

    Returns:
        Ascending indices.
    """
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, most)).round().astype(np.int64))


def frame_index(tree: xr.DataTree, frame: int | None) -> int:
    """Index of a frame number; the middle frame if None.

    Raises:
        ValueError: There is no such frame.
    """
    numbers = frame_numbers(tree)
    if frame is None:
        return len(numbers) // 2
    found = np.flatnonzero(numbers == frame)
    if not len(found):
        raise ValueError(f"the result has no frame {frame}; expected {numbers[0]} to {numbers[-1]}")
    return int(found[0])


def told(tree: xr.DataTree, name: str) -> dict[str, Any]:
    """A table of a result's provenance, such as its settings, by name; empty if the result does not contain it."""
    found = provenance(tree).get(name)
    return found if isinstance(found, dict) else {}


def some_draws(tree: xr.DataTree, name: str, most: int) -> Array | None:
    """Choose draws of the flat state, a site or an extra, evenly over chains and draws.

    Args:
        tree: The result.
        name: The variable.
        most: How many at most.

    Returns:
        (sample, frame, ...); None if there is no such variable.
    """
    values = draws_of(tree, name)
    if values is None:
        return None
    pooled = values.reshape(-1, *values.shape[2:])
    return pooled[evenly(len(pooled), most)]


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


def worst_pairs(tree: xr.DataTree, most: int) -> list[tuple[int, int]]:
    """Find where the chains mix worst.

    Args:
        tree: A diagnosed result.
        most: How many pairs at most, each of another coordinate.

    Returns:
        Pairs (frame index, state_dim index), the largest inefficiency factor first.
    """
    tau = variable(tree, "diagnostics", "tau")
    if tau is None or np.isnan(tau).all():
        return []
    filled = np.nan_to_num(tau, nan=-1.0)
    frames = filled.argmax(axis=0)
    order = np.argsort(-filled.max(axis=0), kind="stable")[:most]
    return [(int(frames[state_dim]), int(state_dim)) for state_dim in order if filled[frames[state_dim], state_dim] > 0]


def has_chains(tree: xr.DataTree) -> bool:
    """Whether the draws are Markov chains long enough to show traces and autocorrelations of."""
    return not is_weighted(tree) and tree["posterior"].sizes["draw"] >= 4


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
