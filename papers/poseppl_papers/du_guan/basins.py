"""The basins of a surface in the plane: which of them a point is in, and the probability of each, by quadrature on a grid."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from poseppl.arrays import Floats

LOW, HIGH, POINTS = np.array([-2.0, -0.8]), np.array([1.6, 2.6]), 400


@lru_cache(maxsize=1)
def _basin_grid(surface: str) -> tuple[Floats, NDArray[np.int_]]:
    """The potential on a grid, and for each point the basin (an index into MINIMA) that steepest descent ends in."""
    module = import_module(surface)
    axes = [np.linspace(low, high, POINTS) for low, high in zip(LOW, HIGH, strict=True)]
    potential = np.asarray(module.mueller_potential(jnp.asarray(np.stack(np.meshgrid(*axes, indexing="ij"), -1))), np.float64)
    padded = np.pad(potential, 1, constant_values=np.inf)
    padded_index = np.pad(np.arange(POINTS**2).reshape(POINTS, POINTS), 1)
    windows = [(slice(i, i + POINTS), slice(j, j + POINTS)) for i in range(3) for j in range(3)]
    lowest = np.argmin([padded[window] for window in windows], 0)
    pointer = np.choose(lowest, [padded_index[window] for window in windows]).ravel()
    for _ in range(20):  # each turn doubles the length of the paths
        pointer = pointer[pointer]
    bottoms = np.stack(np.unravel_index(pointer, (POINTS, POINTS)))
    minima = np.stack(np.unravel_index(_nearest(np.array(module.MINIMA)), (POINTS, POINTS)))
    return potential, np.argmin(np.sum((bottoms[:, :, None] - minima[:, None]) ** 2, 0), 1)


def _nearest(positions: Floats) -> NDArray[np.int_]:
    """Indices (...) of the grid points nearest to positions (..., 2)."""
    steps = np.clip(np.rint((positions - LOW) / (HIGH - LOW) * (POINTS - 1)), 0, POINTS - 1).astype(int)
    nearest: NDArray[np.int_] = steps[..., 0] * POINTS + steps[..., 1]
    return nearest


def true_shares(surface: str, temperature: float) -> Floats:
    """Probability of each basin of a module's surface, by quadrature."""
    potential, basins = _basin_grid(surface)
    weights = np.exp(-(potential - potential.min()) / temperature).ravel()
    return np.asarray(np.bincount(basins, weights) / weights.sum())


def basin_shares(surface: str, positions: Floats) -> Floats:
    """Share of positions (N, 2) in each basin of a module's surface."""
    _, basins = _basin_grid(surface)
    return np.asarray(np.bincount(basins[_nearest(positions)], minlength=basins.max() + 1) / len(positions))
