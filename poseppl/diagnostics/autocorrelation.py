"""Autocorrelation of Markov chains, for many quantities at once, on ArviZ's autocovariance.

Chains lie in axis 0 and draws in axis 1; everything behind them (frames, degrees of freedom, ...) is a batch.

>>> draws = np.random.default_rng(0).standard_normal((4, 1000, 3))
>>> rho = autocorrelation(draws, max_lag=2)
>>> rho.shape, bool(np.all(rho[0] == 1)), bool(np.all(np.abs(rho[1:]) < 0.1))
((3, 3), True, True)
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from poseppl.arrays import Booleans, Floats


@cache
def array_stats() -> Any:
    """ArviZ's functions of arrays. Importing them takes half a second, so it waits for their first use."""
    return import_module("arviz_stats.base").array_stats


def autocovariance(draws: Floats) -> Floats:
    r"""Autocovariance of each chain about the mean of all chains (the biased estimate, a sum over n at every lag).

    ArviZ's ``autocov`` is about each chain's own mean. Let d be the draws less that mean, and delta the distance of that mean
    from the mean of all draws. Let P_k be the sum of the first k entries of d. The autocovariance about the mean of all draws
    is ``autocov_k + delta (P_{n-k} - P_k) / n + (1 - k/n) delta^2``.

    Args:
        draws: (chain, draw, ...).

    Returns:
        (chain, lag, ...) for the lags 0 to draw - 1.
    """
    length = draws.shape[1]
    own = draws.mean(axis=1, keepdims=True)
    delta = own - own.mean(axis=0)
    sums = np.cumsum(draws - own, axis=1)
    first = np.concatenate([np.zeros_like(own), sums[:, :-1]], axis=1)
    share = 1 - np.arange(length).reshape(1, -1, *[1] * (draws.ndim - 2)) / length
    return np.asarray(array_stats().autocov(draws, axis=1) + delta * (sums[:, ::-1] - first) / length + share * delta**2)


def autocorrelation(draws: ArrayLike, max_lag: int | None = None) -> Floats:
    """Autocorrelation of each quantity, averaged over its chains, about the mean of all of them.

    Centring on the common mean lets chains that sit in different places show as correlated at every lag.

    Args:
        draws: (chain, draw, ...).
        max_lag: Largest lag; all lags if None.

    Returns:
        (lag, ...), 1 at lag 0; NaN for a quantity that never changes.
    """
    values = np.asarray(draws, np.float64)
    constant = is_constant(values)
    values = np.where(constant, 0.0, values)
    covariance = autocovariance(values).mean(axis=0)
    variance = np.where(constant, 1.0, covariance[0])
    rho = np.where(constant, np.nan, covariance / variance)
    rho[0] = np.where(constant, np.nan, 1.0)
    return rho if max_lag is None else rho[: max_lag + 1]


def is_constant(draws: Floats) -> Booleans:
    """Whether all draws of a quantity are equal to within the rounding of ``float64``, as ArviZ tests it, or not finite.

    Args:
        draws: (chain, draw, ...).

    Returns:
        (...).
    """
    with np.errstate(invalid="ignore"):
        spread = np.ptp(draws, axis=(0, 1))
    return np.asarray(~(np.isfinite(spread) & (spread >= np.finfo(np.float64).resolution)))
