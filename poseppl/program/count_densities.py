"""Densities of counts that float32 does not round away: Loader's saddle-point form.

The density of a count is a difference of large logarithms. For a Poisson at a million each of them is 10^7, which float32
rounds to 1. Loader (2000), "Fast and accurate computation of binomial probabilities", writes it as

    log Poisson(x | m) = -1/2 log(2 pi x) - S(x) - D(x, m),      D(x, m) = x log(x / m) + m - x,

with S(x) the error of Stirling's formula. Both are small where the density is large, and both are series there. The binomial
and the negative binomial distributions are sums of the same two functions.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from jax.scipy.special import gammaln

_STIRLING = (1 / 12, -1 / 360, 1 / 1260, -1 / 1680, 1 / 1188, -691 / 360360)
"""Coefficients of 1 / n, 1 / n^3, ... in the error of Stirling's formula."""
_LARGE = 16.0
"""Counts from which the series is exact to float64."""
_NEAR, _TERMS = 0.1, 8
"""Relative difference up to which the deviance is a series, and how many terms are exact to float64 there."""
_TINY = 1e-20
"""A mean that is a smaller share of the count is known by its logarithm."""


def stirling_error(n: Array) -> Array:
    """The log of n! minus Stirling's log(sqrt(2 pi n) (n / e)^n), for n > 0, of any shape."""
    large = n >= _LARGE
    inverse = 1 / jnp.where(large, n, _LARGE)
    series = jnp.polyval(jnp.asarray(_STIRLING[::-1], n.dtype), inverse**2) * inverse
    small = jnp.where(large, 1.0, n)
    direct = gammaln(small + 1) - (small + 0.5) * jnp.log(small) + small - 0.5 * math.log(2 * math.pi)
    return jnp.where(large, series, direct)


def deviance(x: Array, mean: Array, log_mean: Array) -> Array:
    """D(x, m) = x log(x / m) + m - x, for x > 0 and m > 0, which is 0 where they are equal.

    Args:
        x: The count.
        mean: m, which may be rounded to 0.
        log_mean: Its logarithm.
    """
    near = jnp.abs(x - mean) < _NEAR * (x + mean)
    m = jnp.where(near, mean, x)
    v = (x - m) / (x + m)
    powers = jnp.asarray([1 / (2 * j + 1) for j in range(_TERMS, 0, -1)], x.dtype)
    series = (x - m) * v + 2 * x * v**3 * jnp.polyval(powers, v**2)
    tiny = mean < _TINY * x
    log_ratio = jnp.where(tiny, jnp.log(x) - log_mean, jnp.log(x / jnp.where(near | tiny, x, mean)))
    return jnp.where(near, series, x * log_ratio + mean - x)


def log_poisson(x: Array, rate: Array) -> Array:
    """Log-density of a Poisson; a rate of 0 gives 0."""
    counts = jnp.where(x > 0, x, 1.0)
    log_rate = jnp.log(jnp.where(rate == 0, 1.0, rate))
    found = -0.5 * jnp.log(2 * math.pi * counts) - stirling_error(counts) - deviance(counts, rate, log_rate)
    found = jnp.where(x > 0, jnp.where(rate == 0, -jnp.inf, found), -rate)
    return jnp.where(x < 0, -jnp.inf, found)


def _log_binomial(k: Array, rest: Array, logs: tuple[Array, Array], shares: tuple[Array, Array]) -> Array:
    """Log-density of k > 0 and the rest > 0 of k + rest trials, given the probabilities of each and their logarithms."""
    n = k + rest
    errors = stirling_error(n) - stirling_error(k) - stirling_error(rest)
    first = deviance(k, n * shares[0], jnp.log(n) + logs[0])
    second = deviance(rest, n * shares[1], jnp.log(n) + logs[1])
    return errors - first - second + 0.5 * jnp.log(n / k / (2 * math.pi * rest))


def log_binomial(k: Array, rest: Array, logs: tuple[Array, Array], shares: tuple[Array, Array]) -> Array:
    """Log-density of k of k + rest trials.

    Args:
        k: Successes.
        rest: Failures.
        logs: Logarithms of the probabilities of both.
        shares: The probabilities.
    """
    inside = (k > 0) & (rest > 0)
    logs_inside = tuple(jnp.where(jnp.isneginf(log), 0.0, log) for log in logs)
    log_p, log_q = logs_inside
    found = _log_binomial(jnp.where(inside, k, 1.0), jnp.where(inside, rest, 1.0), (log_p, log_q), shares)
    found = jnp.where(inside, found, jnp.where(k > 0, k * log_p, rest * log_q))
    impossible = ((k > 0) & jnp.isneginf(logs[0])) | ((rest > 0) & jnp.isneginf(logs[1]))
    return jnp.where((k < 0) | (rest < 0) | impossible, -jnp.inf, found)


def log_negative_binomial(x: Array, size: Array, logs: tuple[Array, Array], shares: tuple[Array, Array]) -> Array:
    """Log-density of x failures before `size` successes, a real number.

    Args:
        x: Failures.
        size: Successes.
        logs: Logarithms of the probabilities of success and failure.
        shares: The probabilities.
    """
    log_p, log_q = (jnp.where(jnp.isneginf(log), 0.0, log) for log in logs)
    counts = jnp.where(x > 0, x, 1.0)
    found = _log_binomial(size, counts, (log_p, log_q), shares) + jnp.log(size / (size + counts))
    found = jnp.where(x > 0, found, size * log_p)
    impossible = jnp.isneginf(logs[0]) | ((x > 0) & jnp.isneginf(logs[1]))
    return jnp.where((x < 0) | impossible, -jnp.inf, found)


def _real(*values: Any) -> list[Array]:
    return jnp.broadcast_arrays(*(jnp.asarray(value, jnp.result_type(float)) for value in values))


def _safe_log(p: Array) -> Array:
    return jnp.where(p == 0, -jnp.inf, jnp.log(jnp.where(p == 0, 1.0, p)))


def _shares_of_probs(p: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Logarithms of p and 1 - p, and both."""
    log_q = jnp.where(p == 1, -jnp.inf, jnp.log1p(-jnp.where(p == 1, 0.0, p)))
    return (_safe_log(p), log_q), (p, 1 - p)


def _shares_of_logits(logits: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    return (-jax.nn.softplus(-logits), -jax.nn.softplus(logits)), (jax.nn.sigmoid(logits), jax.nn.sigmoid(-logits))


def _reversed(pairs: tuple[tuple[Array, Array], tuple[Array, Array]]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    logs, shares = pairs
    return logs[::-1], shares[::-1]


def _poisson(law: Any, value: Any) -> Array:
    return log_poisson(*_real(value, law.rate))


def _binomial(law: Any, value: Any) -> Array:
    # the difference before it is rounded: totals may be beyond 2^24
    of_logits = isinstance(law, dist.BinomialLogits)
    k, rest, parameter = _real(value, law.total_count - value, law.logits if of_logits else law.probs)
    return log_binomial(k, rest, *(_shares_of_logits if of_logits else _shares_of_probs)(parameter))


def _gamma_poisson(law: Any, value: Any) -> Array:
    x, size, rate = _real(value, law.concentration, law.rate)
    logs = -jnp.log1p(1 / rate), -jnp.log1p(rate)
    return log_negative_binomial(x, size, logs, (1 / (1 + 1 / rate), 1 / (1 + rate)))


def _negative_binomial_probs(law: Any, value: Any) -> Array:
    x, size, probs = _real(value, law.total_count, law.probs)
    return log_negative_binomial(x, size, *_reversed(_shares_of_probs(probs)))


def _negative_binomial_logits(law: Any, value: Any) -> Array:
    x, size, logits = _real(value, law.total_count, law.logits)
    return log_negative_binomial(x, size, *_reversed(_shares_of_logits(logits)))


_DENSITIES: dict[type, Callable[[Any, Any], Array]] = {
    dist.Poisson: _poisson,
    dist.BinomialProbs: _binomial,
    dist.BinomialLogits: _binomial,
    dist.GammaPoisson: _gamma_poisson,
    dist.NegativeBinomial2: _gamma_poisson,
    dist.NegativeBinomialProbs: _negative_binomial_probs,
    dist.NegativeBinomialLogits: _negative_binomial_logits,
}
"""Densities by the very type of a distribution: what inherits from one may have another density."""
_INNER = ("base_dist", "_component_distribution", "_component_distributions")
"""The attributes in which distributions that wrap, inflate or mix others keep these."""


def stable(distribution: Any) -> Any:
    """The distribution, whose counts have the densities of this module wherever it wraps, inflates or mixes such counts."""
    if isinstance(distribution, list | tuple):
        parts = [stable(part) for part in distribution]
        return distribution if all(map(lambda a, b: a is b, parts, distribution)) else type(distribution)(parts)
    if type(distribution) in _DENSITIES:
        return _replaced(distribution, "log_prob", partial(_DENSITIES[type(distribution)], distribution))
    for name in _INNER:
        inner = vars(distribution).get(name)
        if inner is not None and stable(inner) is not inner:
            return _replaced(distribution, name, stable(inner))
    return distribution


def _replaced(distribution: Any, name: str, value: Any) -> Any:
    other = copy.copy(distribution)
    vars(other)[name] = value
    return other


def is_rounded_count(distribution: Any) -> bool:
    """Whether a distribution of integers has a density that is a difference of log-factorials, which float32 rounds."""
    base = distribution
    while isinstance(base, dist.Independent | dist.MaskedDistribution | dist.ExpandedDistribution):
        base = base.base_dist
    exact = dist.Delta | dist.DiscreteUniform | dist.BernoulliProbs | dist.BernoulliLogits | dist.CategoricalProbs
    known = isinstance(base, exact | dist.CategoricalLogits | dist.GeometricProbs | dist.GeometricLogits)
    return bool(base.is_discrete) and not known and stable(base) is base
