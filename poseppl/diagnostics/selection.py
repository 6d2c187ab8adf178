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


def provenance_table(tree: xr.DataTree, name: str) -> dict[str, Any]:
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
