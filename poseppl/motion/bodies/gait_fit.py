"""A gait in closed form: harmonics of one cycle, fitted to the states of a recorded walk.

Every coordinate x_j of the state is

    x_j(t) = c_j + v_j t + sum over k = 1..K of a_jk cos(2 pi k t / P) + b_jk sin(2 pi k t / P),

with the drift v for the two horizontal coordinates of the root alone. For a given period P that is linear least squares; P is
the one with the smallest sum of squares, sought on a grid and then refined. Squares of angles are counted at 300 mm a radian,
so that they compare with those of positions. The walk is turned to head along +X, with the root over the origin at t = 0
apart from its sway.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from poseppl.arrays import Floats
from poseppl.checks import check_at_least

ARM = 300.0
"""Lever (mm) at which errors of angles are weighed against those of positions."""
PERIODS = (0.6, 2.0)
"""Periods (seconds) among which a gait cycle is sought: two steps."""
_HEADING = 3
"""Index of the coordinate that turns the whole body about the vertical axis."""


class Gait(NamedTuple):
    """Coefficients of a gait.

    Attributes:
        period: Seconds a cycle.
        mean: (d,) constants, mm and radians.
        drift: (d,) mm a second; zero but for the root's horizontal position.
        cosine: (K, d) coefficients of the cosines.
        sine: (K, d) coefficients of the sines.
    """

    period: float
    mean: Floats
    drift: Floats
    cosine: Floats
    sine: Floats

    def at(self, times: ArrayLike) -> Floats:
        """States (T, d) at times (T,) in seconds."""
        seconds = np.asarray(times, np.float64)[:, None]
        order = np.arange(1, len(self.cosine) + 1)
        phase = 2 * np.pi * order * seconds / self.period
        states: Floats = self.mean + seconds * self.drift + np.cos(phase) @ self.cosine + np.sin(phase) @ self.sine
        return states


def fit_gait(states: ArrayLike, rate: float, num_harmonics: int = 4) -> Gait:
    """Fit a gait to the states of a walk along a straight line.

    Args:
        states: (T, d): x, y, z of the root in mm, then angles in radians without jumps.
        rate: Frames a second.
        num_harmonics: K, at least 1.

    Returns:
        The gait, heading along +X.

    Raises:
        ValueError: The recording is too short for a cycle, holds NaN, or does not move.
    """
    values = np.array(states, np.float64)
    seconds = np.arange(len(values)) / rate
    if values.ndim != 2 or not np.isfinite(values).all():
        raise ValueError(f"states have shape {values.shape}, expected (T, d), all finite")
    check_at_least(1, num_harmonics=num_harmonics)
    shortest, longest = PERIODS[0], min(PERIODS[1], seconds[-1] / 1.1)
    if longest <= shortest or len(values) <= 2 * (2 * num_harmonics + 2):
        raise ValueError(f"{len(values)} frames at {rate:g} a second are too short for a gait cycle")
    values = _head_along_x(values, seconds)
    grid = np.linspace(shortest, longest, 200)
    costs = [_fit(values, seconds, period, num_harmonics)[1] for period in grid]
    best = int(np.argmin(costs))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])

    def error(period: float) -> float:
        return float(_fit(values, seconds, period, num_harmonics)[1])

    found = scipy.optimize.minimize_scalar(error, bounds=bounds, method="bounded")
    gait, _ = _fit(values, seconds, float(found.x), num_harmonics)
    gait.mean[:2] = 0.0
    return gait


def to_table(gait: Gait, coordinates: tuple[str, ...]) -> dict[str, Any]:
    """Round a gait to what a table needs: hundredths of a millimetre and ten-thousandths of a radian.

    Returns:
        ``period``, ``drift`` (three numbers, mm a second) and for every coordinate ``[mean, a_1, b_1, a_2, b_2, ...]``.
    """
    rows = np.concatenate([gait.mean[None], np.stack([gait.cosine, gait.sine], 1).reshape(-1, len(gait.mean))])
    return {
        "period": round(gait.period, 5),
        "drift": [round(float(value), 2) for value in gait.drift[:3]],
        "coefficients": {
            name: [round(float(value), 2 if i < 3 else 4) + 0.0 for value in rows[:, i]] for i, name in enumerate(coordinates)
        },
    }


def from_table(table: Mapping[str, Any], coordinates: tuple[str, ...]) -> Gait:
    """Rebuild a gait from :func:`to_table`.

    Raises:
        ValueError: The table's coordinates are not the given ones.
    """
    rows = table["coefficients"]
    if set(rows) != set(coordinates):
        raise ValueError(f"the gait has coordinates {sorted(rows)}, expected {sorted(coordinates)}")
    values = np.array([rows[name] for name in coordinates], np.float64).T
    drift = np.zeros(len(coordinates))
    drift[:3] = table["drift"]
    return Gait(float(table["period"]), values[0], drift, values[1::2], values[2::2])


def _head_along_x(values: Floats, seconds: Floats) -> Floats:
    """Turn the walk so that the line through its path points along +X."""
    slope = np.polyfit(seconds, values[:, :2], 1)[0]
    if np.hypot(*slope) < 1.0:
        raise ValueError("the root does not move: no direction to walk in")
    angle = -np.arctan2(slope[1], slope[0])
    cosine, sine = np.cos(angle), np.sin(angle)
    turned = values.copy()
    turned[:, :2] = values[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
    turned[:, _HEADING] += angle
    turned[:, 3:] -= 2 * np.pi * np.round(turned[:, 3:].mean(0) / (2 * np.pi))
    return turned


def _fit(values: Floats, seconds: Floats, period: float, num_harmonics: int) -> tuple[Gait, float]:
    """Linear least squares for one period, and the weighted sum of squares that is left."""
    phase = 2 * np.pi * np.arange(1, num_harmonics + 1) * seconds[:, None] / period
    basis = np.concatenate([np.ones((len(seconds), 1)), np.cos(phase), np.sin(phase), seconds[:, None]], 1)
    coefficients = np.zeros((basis.shape[1], values.shape[1]))
    coefficients[:, :2] = np.linalg.lstsq(basis, values[:, :2], rcond=None)[0]
    coefficients[:-1, 2:] = np.linalg.lstsq(basis[:, :-1], values[:, 2:], rcond=None)[0]
    residual = values - basis @ coefficients
    weight = np.where(np.arange(values.shape[1]) < 3, 1.0, ARM)
    mean, cosine, sine = coefficients[0], coefficients[1 : num_harmonics + 1], coefficients[num_harmonics + 1 : -1]
    return Gait(period, mean.copy(), coefficients[-1].copy(), cosine, sine), float(np.sum((residual * weight) ** 2))
