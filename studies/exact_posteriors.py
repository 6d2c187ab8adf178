"""Exact posteriors of whole trajectories by NumPy and SciPy in double precision, without this library.

The joint Gaussian of a trajectory, sums over all states of a chain, and sums over a fine grid.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
GAUSSIAN, CHAIN, GRID = (
    "the joint Gaussian of the trajectory (NumPy)",
    "sums over all states (NumPy)",
    "a grid of {} points (NumPy, SciPy)",
)
COUNT = 10
"""Frames."""


class Exact(NamedTuple):
    """Log-evidence of all data; mean and standard deviation (T,) of one quantity, filtered and smoothed."""

    evidence: float
    filtered: tuple[Array, Array]
    smoothed: tuple[Array, Array]


def joint_gaussian(data: Any, matrix: Any, noise: Any, load: Any, error: Any, start: Any, index: int) -> Exact:
    """Posterior of x_t = F_t x_(t-1) + e, y_t = H x_t + r, from the joint covariance of all states.

    Args:
        data: (T, k), NaN where missing.
        matrix: F (d, d), or (T, d, d) whose row t leads into frame t.
        noise: Covariance of e, likewise.
        load: H (k, d).
        error: Covariance of r (k, k).
        start: Mean (d,) and covariance (d, d) at the first frame.
        index: The coordinate whose moments are returned.
    """
    data, load = np.atleast_2d(np.asarray(data, float).T).T, np.asarray(load, float)
    count, size = len(data), load.shape[1]
    matrices, noises = (np.broadcast_to(np.asarray(each, float), (count, size, size)) for each in (matrix, noise))
    mean, covariance = np.zeros(count * size), np.zeros((count * size, count * size))
    mean[:size], covariance[:size, :size] = start
    for frame in range(1, count):
        now, before = slice(frame * size, (frame + 1) * size), slice((frame - 1) * size, frame * size)
        past = slice(0, frame * size)
        mean[now] = matrices[frame] @ mean[before]
        covariance[now, past] = matrices[frame] @ covariance[before, past]
        covariance[past, now] = covariance[now, past].T
        covariance[now, now] = matrices[frame] @ covariance[before, before] @ matrices[frame].T + noises[frame]

    def given(frames: int) -> tuple[Array, Array, float]:
        seen = ~np.isnan(data[:frames]).ravel()
        observe = np.kron(np.eye(frames), load)[seen] @ np.eye(frames * size, count * size)
        spread = observe @ covariance @ observe.T + np.kron(np.eye(frames), error)[np.ix_(seen, seen)]
        residual = data[:frames].ravel()[seen] - observe @ mean
        gain = covariance @ observe.T @ np.linalg.inv(spread)
        evidence = stats.multivariate_normal(np.zeros(len(residual)), spread).logpdf(residual) if seen.any() else 0.0
        return mean + gain @ residual, np.diag(covariance - gain @ observe @ covariance), float(evidence)

    places = np.arange(count) * size + index
    parts = [given(frame + 1) for frame in range(count)]
    filtered = np.array([[part[0][place], part[1][place]] for part, place in zip(parts, places, strict=True)])
    means, variances, evidence = parts[-1]
    return Exact(evidence, (filtered[:, 0], np.sqrt(filtered[:, 1])), (means[places], np.sqrt(variances[places])))


def markov(values: Any, initial: Any, transition: Any, log_likelihood: Any) -> Exact:
    """Posterior of a chain of n states by forward and backward sums.

    Args:
        values: The quantity in each state (n,).
        initial: Probabilities, or densities up to a factor (n,).
        transition: Row i holds the probabilities of the states after state i, up to a factor; (n, n) or (T, n, n).
        log_likelihood: (T, n).
    """
    values, log_likelihood = np.asarray(values, float), np.asarray(log_likelihood, float)
    count, size = log_likelihood.shape
    moves = np.asarray(transition, float)
    moves = np.broadcast_to(moves / moves.sum(-1, keepdims=True), (count, size, size))
    peaks = log_likelihood.max(1)
    likelihood = np.exp(log_likelihood - peaks[:, None])
    filtered, evidence = [], 0.0
    state = np.asarray(initial, float) / np.sum(initial)
    for frame in range(count):
        joint = (filtered[-1] @ moves[frame] if frame else state) * likelihood[frame]
        evidence += float(np.log(joint.sum()) + peaks[frame])
        filtered.append(joint / joint.sum())
    future = [np.ones(size)]
    for frame in range(count - 1, 0, -1):
        back = moves[frame] @ (likelihood[frame] * future[0])
        future.insert(0, back / back.max())
    smoothed = np.array(filtered) * np.array(future)
    smoothed /= smoothed.sum(1, keepdims=True)

    def moments(shares: Array) -> tuple[Array, Array]:
        mean = shares @ values
        return mean, np.sqrt(np.maximum(shares @ values**2 - mean**2, 0.0))

    return Exact(evidence, moments(np.array(filtered)), moments(smoothed))


def on_grid(low: float, high: float, log_initial: Any, log_transition: Any, log_likelihood: Any, size: int = 1201) -> Exact:
    """Posterior of a real state on a grid; densities are functions, the transition's of the new and the old state."""
    grid = np.linspace(low, high, size)
    moves = np.exp(log_transition(grid[None], grid[:, None]))
    return markov(grid, np.exp(log_initial(grid)), moves, np.stack([log_likelihood(t, grid) for t in range(COUNT)]))
