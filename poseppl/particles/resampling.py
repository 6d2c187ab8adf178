r"""Resampling: draw ancestors so that particle i has e_i = num * w_i children on average.

Every scheme is unbiased, E[children of i] = e_i, and they differ in the spread. With C_i = e_1 + ... + e_i and the slots
k = 0, ..., num - 1,

* multinomial: num independent draws;
* residual: floor(e_i) children for sure, the rest multinomial (Liu and Chen 1998, doi:10.1080/01621459.1998.10473765);
* stratified: slot k takes the particle that owns k + u_k, C_(i-1) <= k + u_k < C_i (Kitagawa 1996, doi:10.2307/1390750);
* systematic: the same with one u for all slots.

Douc, Cappe and Moulines 2005 (doi:10.1109/ISPA.2005.195385) compare them. Ancestors of all but multinomial come out in order.

In float32, C_i near N = 100,000 would have 7 bits left of the unit that decides. Here C_i is a whole number and a fraction of
20 bits (see `running`), both exact, at any N; uniform weights give every particle exactly one child. Slots are shared out by
counting ends and a running sum, without a sort or a search. Particles of zero (or NaN) weight never have children; if no weight
is left, all count alike (see `weights.normalise`).

Example:
    >>> systematic(jax.random.key(0), jnp.log(jnp.array([0.5, 0.0, 0.25, 0.25])), 4).tolist()
    [0, 0, 2, 3]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_choice
from poseppl.particles.prefix_sum import Split, largest_sum, running_split_sum, running_sum, split_number, unit
from poseppl.particles.weights import without_nan

Resampling = Callable[[Array, Array, int], Array]
Scheme = Literal["systematic", "stratified", "residual", "multinomial"]


def _expected_children(log_weights: Array, num: int) -> Array:
    """e_i = num * w_i (N,), which add up to num beyond the precision of one sum."""
    clean = without_nan(log_weights)
    peak = jnp.max(clean)
    weights = jnp.where(jnp.isfinite(peak), jnp.exp(clean - jnp.where(jnp.isfinite(peak), peak, 0.0)), 1.0)
    expected = weights * (num / jnp.sum(weights))
    nearest = jnp.round(expected)
    excess = (jnp.sum(nearest.astype(jnp.int32)) - num).astype(expected.dtype) + jnp.sum(expected - nearest)
    return expected * (1.0 - excess / num)


def _cumulative(expected: Array, num: int) -> Split:
    """C_i (N,); the fraction is in units."""
    if num >= largest_sum(expected.dtype):
        limit = largest_sum(expected.dtype)
        raise ValueError(f"num is {num}; resampling in {expected.dtype} is exact below {limit}: use jax_enable_x64")
    return running_split_sum(split_number(expected))


def _share_slots(ends: Array, alive: Array, num: int) -> Array:
    """Ancestors (num,) int32, when particle i owns the slots from the end of particle i - 1 up to `ends[i]` (N,)."""
    passed = jnp.zeros(num, ends.dtype).at[ends.astype(jnp.int32)].add(1.0, mode="drop", indices_are_sorted=True)
    return jnp.minimum(running_sum(passed).astype(jnp.int32), _last(alive))


def _last(alive: Array) -> Array:
    """The last particle that has weight: the end may fall short of the last slot by a rounding."""
    return jnp.max(jnp.where(alive, jnp.arange(alive.shape[0], dtype=jnp.int32), 0))


def systematic(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Systematic resampling.

    Args:
        rng_key: PRNG key.
        log_weights: Unnormalised log-weights (N,).
        num: Number of ancestors to draw.

    Returns:
        Ancestors (num,), int32, ascending.
    """
    expected = _expected_children(log_weights, num)
    ends = _cumulative(expected, num)
    offset = jax.random.uniform(rng_key, dtype=expected.dtype) / unit(expected.dtype)
    return _share_slots(ends.whole + (ends.fraction > offset), expected > 0, num)


def stratified(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Stratified resampling; arguments and result as in `systematic`."""
    expected = _expected_children(log_weights, num)
    ends = _cumulative(expected, num)
    offsets = jax.random.uniform(rng_key, (num,), expected.dtype) / unit(expected.dtype)
    own = offsets[jnp.clip(ends.whole.astype(jnp.int32), 0, num - 1)]
    return _share_slots(ends.whole + (ends.fraction > own), expected > 0, num)


def multinomial(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Multinomial resampling: independent draws, in no order; arguments and result as in `systematic`."""
    return _draw_independently(rng_key, _expected_children(log_weights, num), num)


def residual(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Residual resampling: the sure children first, in order, then the drawn ones; otherwise as `systematic`."""
    expected = _expected_children(log_weights, num)
    sure = jnp.floor(expected)
    ends = running_sum(sure)
    rest = expected - sure
    total = jnp.sum(rest)
    scaled = jnp.where(total > 0, rest * (num / jnp.where(total > 0, total, 1.0)), expected)
    drawn = _draw_independently(rng_key, scaled, num)
    copied = _share_slots(ends, sure > 0, num)
    return jnp.where(jnp.arange(num) < ends[-1], copied, drawn)


def _draw_independently(rng_key: Array, expected: Array, num: int) -> Array:
    """Ancestors (num,) drawn independently in proportion to `expected` (N,), whose sum is num.

    Slot and position in the slot are drawn and compared in fixed point of 32 bits, 15 of them after the point at 100,000.
    """
    cumulative = _cumulative(expected, num)
    bits = 32 - int(num).bit_length()
    scale = unit(expected.dtype) * 2.0**bits
    within = jnp.minimum((cumulative.fraction * scale).astype(jnp.uint32), jnp.uint32(2**bits - 1))
    ends = (jnp.clip(cumulative.whole, 0, num).astype(jnp.uint32) << bits) + within
    high, low, point = jax.random.bits(rng_key, (3, num), jnp.uint32)
    # as in jax.random.randint, the remainder of 64 bits, of which a number that is no power of 2 hardly prefers any
    slots = ((high % num) * (2**32 % num) + low % num) % num
    drawn = (slots << bits) + (point >> (32 - bits))
    return jnp.minimum(jnp.searchsorted(ends, drawn, side="right").astype(jnp.int32), _last(expected > 0))


SCHEMES: dict[Scheme, Resampling] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def resampling_scheme(name: Scheme) -> Resampling:
    """The scheme of a name.

    Raises:
        ValueError: An unknown name.
    """
    check_choice(Scheme, resampling=name)
    return SCHEMES[name]


def resample(rng_key: Array, log_weights: Array, num: int, scheme: Scheme = "systematic") -> Array:
    """Ancestors (num,) int32 by the scheme of a name.

    Raises:
        ValueError: An unknown name.
    """
    return resampling_scheme(scheme)(rng_key, log_weights, num)
