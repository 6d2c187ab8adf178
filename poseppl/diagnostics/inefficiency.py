"""Autocorrelation and inefficiency factors of Markov chains, effective sample sizes, split R-hat and Monte Carlo errors.

The mean of N draws of a Markov chain has the variance ``tau / N`` times that of the target (Choo and Fleet 2001, Eq. 8, DOI
10.1109/ICCV.2001.937643): ``tau`` draws are worth one independent draw. There are two estimates:

* ``inefficiency``: N / ESS for the mean, one over the relative effective sample size, exactly as
  ``arviz_stats.base.array_stats.ess(..., method="mean")`` has it: halved chains and Geyer's initial monotone sequence
  (Vehtari et al. 2021, DOI 10.1214/20-BA1221). It is floored at ``1 / log10(N)``.
* ``windowed_inefficiency``: ``1 + 2 sum (1 - k/n) rho_k`` over lags ``k`` up to the smallest ``w >= 5 tau(w)`` (Sokal 1997,
  DOI 10.1007/978-1-4899-0319-8_6), which has no floor. If that falls below 1, the lags are those of Geyer's initial positive
  sequence (Geyer 1992, DOI 10.1214/ss/1177011137), for antithetic chains; where chains are too short for such a window all
  lags count, and it cannot exceed the chain's length.

The standard error of an estimate from N draws is ``tau sqrt(2 (2 w + 1) / N)`` with a window ``w = 5 tau`` (Sokal 1997). The
SD of replicates is within a third of it where chains are much longer than tau.

ArviZ's ``ess``, ``rhat`` and ``mcse`` loop over quantities, of which a minute of tracking has fifty thousand. The functions
here, on ArviZ's autocovariance, take a quarter to a tenth of their processor time (``python -m benchmarks.diagnostics``;
arviz-stats 0.8 and 1.3). The ESS of ``arviz_stats.numba.diagnostics`` takes 1.1 to 1.7 times ours, but needs numba and einops,
which are not installed with this package, and has neither this R-hat nor an MCSE. Ours agree with ArviZ's to rounding
(tests/diagnostics/test_inefficiency.py). All but ``mixing`` take ArviZ's data, too, a DataTree, Dataset or DataArray with
dimensions ``chain`` and ``draw``, and give such without these.

>>> draws = np.random.default_rng(0).standard_normal((4, 5000, 2))
>>> inefficiency(draws).round(1).tolist(), split_rhat(draws).round(2).tolist()
([1.0, 1.0], [1.0, 1.0])

Chains lie in axis 0 and draws in axis 1; everything behind them (frames, degrees of freedom, ...) is a batch.

>>> draws = np.random.default_rng(0).standard_normal((4, 1000, 3))
>>> rho = autocorrelation(draws, max_lag=2)
>>> rho.shape, bool(np.all(rho[0] == 1)), bool(np.all(np.abs(rho[1:]) < 0.1))
((3, 3), True, True)
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, wraps
from importlib import import_module
from typing import Any, NamedTuple, Protocol, overload

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from poseppl.arrays import Booleans, Floats

MIN_DRAWS = 4
WINDOW = 5.0


class OverDraws(Protocol):
    """A function of draws: of an array (chain, draw, ...), or of xarray's data by the names of the dimensions."""

    @overload
    def __call__(self, draws: xr.DataTree | xr.Dataset) -> xr.Dataset: ...
    @overload
    def __call__(self, draws: xr.DataArray) -> xr.DataArray: ...
    @overload
    def __call__(self, draws: ArrayLike) -> Floats: ...


def over_draws(function: Callable[[Floats], Floats]) -> OverDraws:
    """Let a function of an array (chain, draw, ...) take ArviZ's data.

    >>> @over_draws
    ... def mean(draws):
    ...     return draws.mean(axis=(0, 1))
    >>> mean(xr.DataArray(np.ones((3, 2, 5)), dims=("frame", "chain", "draw"))).dims
    ('frame',)

    Args:
        function: From (chain, draw, ...) to (...).

    Returns:
        The function, NaN of fewer than four draws; of a DataTree it takes the group ``posterior``, of a Dataset the variables
        that have draws.
    """

    @wraps(function)
    def labelled(draws: Any) -> Any:
        if isinstance(draws, xr.DataTree):
            return labelled(draws["posterior"].dataset)
        if isinstance(draws, xr.Dataset):
            return xr.Dataset({name: labelled(each) for name, each in draws.items() if {"chain", "draw"} <= set(each.dims)})
        if isinstance(draws, xr.DataArray):
            return xr.apply_ufunc(
                lambda values: labelled(np.moveaxis(values, (-2, -1), (0, 1))), draws, input_core_dims=[["chain", "draw"]]
            )
        values = np.asarray(draws, np.float64)
        return function(values) if values.shape[1] >= MIN_DRAWS else np.full(values.shape[2:], np.nan)

    return labelled


class Mixing(NamedTuple):
    """How well chains mix, each of the shape of the batch: see the functions of the same names; ``_se`` is a standard error."""

    tau: Floats
    tau_se: Floats
    tau_windowed: Floats
    ess: Floats
    rhat: Floats
    mcse: Floats


def mixing(draws: ArrayLike) -> Mixing:
    """Compute all measures of this module.

    Args:
        draws: (chain, draw, ...).

    Returns:
        The measures, NaN where they are not defined.
    """
    values = np.asarray(draws, np.float64)
    tau, count = inefficiency(values), np.prod(values.shape[:2])
    window = np.minimum(np.ceil(WINDOW * tau), values.shape[1] - 1)
    ess = values.shape[0] * 2 * (values.shape[1] // 2) / tau
    deviation = np.where(np.isnan(tau), 0.0, values).std(axis=(0, 1), ddof=1) if values.shape[1] >= MIN_DRAWS else tau
    error = tau * np.sqrt(2 * (2 * window + 1) / count)
    return Mixing(tau, error, windowed_inefficiency(values), ess, split_rhat(values), deviation / np.sqrt(ess))


@over_draws
def inefficiency(draws: Floats) -> Floats:
    """Inefficiency factor for the mean, one over ArviZ's relative effective sample size.

    Args:
        draws: (chain, draw, ...).

    Returns:
        (...), NaN where there are fewer than 4 draws, where all draws are equal, and where one is not finite.
    """
    halves = _split(draws)
    constant = is_constant(draws) | is_constant(halves)
    rho = _geyer_autocorrelation(np.where(constant, 0.0, halves))
    floor = 1 / np.log10(halves.shape[0] * halves.shape[1])
    return np.where(constant, np.nan, np.maximum(_monotone_sum(rho), floor))


@over_draws
def windowed_inefficiency(draws: Floats) -> Floats:
    """Inefficiency factor by Sokal's window.

    Args:
        draws: (chain, draw, ...).

    Returns:
        (...), NaN as in :func:`inefficiency`.
    """
    length, rho = draws.shape[1], autocorrelation(draws)
    partial = 2 * np.cumsum(rho, axis=0) - 1
    lags = np.arange(length).reshape(-1, *[1] * (rho.ndim - 1))
    wide = _first(lags >= WINDOW * np.maximum(partial, 0))
    sokal = np.take_along_axis(partial, wide[None], axis=0)[0]
    positive = 2 * _first(rho[0 : length - 1 : 2] + rho[1::2] <= 0) - 1
    geyer = np.take_along_axis(partial, positive[None], axis=0)[0]
    return np.asarray(np.where(sokal >= 1, sokal, geyer))


@over_draws
def split_rhat(draws: Floats) -> Floats:
    """Gelman and Rubin's R-hat of halved chains, as ArviZ's method "split".

    Args:
        draws: (chain, draw, ...).

    Returns:
        (...), NaN as in :func:`inefficiency` and for a single chain; inf where chains are stuck in different places.
    """
    if draws.shape[0] < 2:
        return np.full(draws.shape[2:], np.nan)
    halves = _split(draws)
    length = halves.shape[1]
    constant = is_constant(draws) | is_constant(halves)
    halves = np.where(constant, 0.0, halves)
    between = length * halves.mean(axis=1).var(axis=0, ddof=1)
    within = halves.var(axis=1, ddof=1).mean(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        rhat = np.sqrt((between / within + length - 1) / length)
    return np.where(constant, np.nan, rhat)


def _first(condition: Booleans) -> NDArray[np.intp]:
    """Index of the first True along axis 0; the length of the axis less one where there is none."""
    marked = condition.copy()
    marked[-1] = True
    return np.asarray(np.argmax(marked, axis=0))


def _split(values: Floats) -> Floats:
    half = values.shape[1] // 2
    return np.concatenate([values[:, :half], values[:, -half:]])


def _geyer_autocorrelation(halves: Floats) -> Floats:
    """Autocorrelation (lag, ...) from the variances within and between chains; zero where nothing varies."""
    chains, length = halves.shape[:2]
    covariance = array_stats().autocov(halves, axis=1).mean(axis=0)
    within = covariance[0] * length / (length - 1)
    total = covariance[0].copy()
    if chains > 1:
        total += halves.mean(axis=1).var(axis=0, ddof=1)
    rho = 1 - (within - covariance) / np.where(total > 0, total, 1.0)
    rho[0] = 1.0
    return np.asarray(rho)


def _monotone_sum(rho: Floats) -> Floats:
    """Sum Geyer's initial positive, then monotone, sequence of pairs of lags, as ArviZ closes it."""
    length = rho.shape[0]
    even, odd = rho[0 : length - 1 : 2], rho[1::2]
    pairs = even + odd
    last = max((length - 3) // 2, 0)
    end = _first(pairs[: last + 1] <= 0)
    kept = np.arange(len(pairs)).reshape(-1, *[1] * (rho.ndim - 1)) < end
    falling = np.minimum.accumulate(np.where(kept, pairs, np.inf), axis=0)
    total = np.where(kept, falling, 0.0).sum(axis=0)
    index = end[None]
    rest = np.take_along_axis(even, index, axis=0)[0]
    closing = np.where((rest > 0) | (np.take_along_axis(pairs, index, axis=0)[0] >= 0), rest, 0.0)
    return np.asarray(-1 + 2 * total + closing)


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
