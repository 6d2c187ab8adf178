"""The chaotic job: Lorenz's model of 1996 in 40 dimensions, every other coordinate seen with noise 1; filtered means.

A frame is one step of Runge and Kutta of 0.05 units, after which noise N(0, 0.1^2) is added. There is no exact answer: errors
are from the truth.
"""

from __future__ import annotations

from typing import Any

import numpy as np

DIMENSION, STEP, NOISE, NUM_FRAMES, NUM_MEMBERS, FORCING = 40, 0.1, 1.0, 100, 100, 8.0


def advance(x: Any, xp: Any) -> Any:
    """The state (d,) a frame later, without noise, by NumPy or JAX's NumPy."""

    def derivative(x: Any) -> Any:
        return (xp.roll(x, -1) - xp.roll(x, 2)) * xp.roll(x, 1) - x + FORCING

    a = derivative(x)
    b = derivative(x + 0.025 * a)
    c = derivative(x + 0.025 * b)
    d = derivative(x + 0.05 * c)
    return x + 0.05 / 6 * (a + 2 * b + 2 * c + d)


def start() -> np.ndarray:
    """Mean (d,) of the first state, on the attractor; its standard deviation is 1."""
    x = FORCING + 0.01 * (np.arange(DIMENSION) == 0)
    for _ in range(400):
        x = advance(x, np)
    return x


def _simulated() -> tuple[np.ndarray, np.ndarray]:
    rng, states, data = np.random.default_rng(2), [], []
    x = start() + rng.normal(size=DIMENSION)
    for _ in range(NUM_FRAMES):
        states.append(x)
        data.append(x[::2] + NOISE * rng.normal(size=DIMENSION // 2))
        x = advance(x, np) + STEP * rng.normal(size=DIMENSION)
    return np.array(states), np.array(data)


def draw() -> np.ndarray:
    """Data (T, d / 2)."""
    return _simulated()[1]


def exact(data: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The true states (T, d), and ones as the units of errors."""
    states = _simulated()[0]
    return states, np.ones_like(states)
