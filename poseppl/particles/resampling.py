r"""Resampling: draw ancestors so that particle i has e_i = num * w_i children on average.

Every scheme is unbiased, E[children of i] = e_i, and they differ in the spread. With C_i = e_1 + ... + e_i and the slots
k = 0, ..., num - 1,

* multinomial: num independent draws;
* residual: floor(e_i) children for sure, the rest multinomial (Liu and Chen 1998, doi:10.1080/01621459.1998.10473765);
* stratified: slot k takes the particle that owns k + u_k, C_(i-1) <= k + u_k < C_i (Kitagawa 1996, doi:10.2307/1390750);
* systematic: the same with one u for all slots.

BlackJAX has the same four. These are not its own because of their speed and precision: with 100,000 particles they take between
a tenth (residual) and a half (stratified, multinomial) of its processor time (``python -m benchmarks.blackjax_pieces``), and of
a million equal weights in float32 every particle is kept (``pytest --full tests/kernels/test_blackjax_limits.py``).

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

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_choice
from poseppl.particles.prefix_sum import Split, largest_sum, running_split_sum, running_sum, split_number, unit
from poseppl.particles.weights import nan_to_neg_inf

Resampling = Callable[[Array, Array, int], Array]
Scheme = Literal["systematic", "stratified", "residual", "multinomial"]


def _weights(log_weights: Array) -> Array:
    """Weights (N,) of which the largest is 1, without NaN; all are 1 where none is left."""
    clean = nan_to_neg_inf(log_weights)
    peak = jnp.max(clean)
    known = jnp.isfinite(peak)
    weights: Array = jnp.where(known, jnp.exp(clean - jnp.where(known, peak, 0.0)), 1.0)
    return weights


def _expected_children(weights: Array, num: Any) -> Array:
    """e_i = num * w_i (N,), which add up to num beyond the precision of one sum."""
    expected = weights * (num / jnp.sum(weights))
    nearest = jnp.round(expected)
    whole, rest = jnp.sum(jnp.stack([nearest, expected - nearest]), 1)  # of which the first is exact
    scaled: Array = expected * (1.0 - (whole - num + rest) / num)
    return scaled


def _cumulative(expected: Array, num: int) -> Split:
    """C_i (N,); the fraction is in units."""
    if num >= largest_sum(expected.dtype):
        limit = largest_sum(expected.dtype)
        raise ValueError(f"num is {num}; resampling in {expected.dtype} is exact below {limit}: use jax_enable_x64")
    return running_split_sum(split_number(expected))


def _share_slots(cumulative: Split, ends: Array, num: int) -> Array:
    """Ancestors (num,) int32, when particle i, with C_i, owns the slots from the end of particle i - 1 to `ends[i]` (N,)."""
    ends = jnp.where(_complete(cumulative), num, ends)
    passed = jnp.zeros(num, ends.dtype).at[ends.astype(jnp.int32)].add(1.0, mode="drop", indices_are_sorted=True)
    return running_sum(passed).astype(jnp.int32)


def _complete(cumulative: Split) -> Array:
    """From which particle (N,) on the others have no weight: it has the last slot, of which C_N may fall short."""
    return (cumulative.whole == cumulative.whole[-1]) & (cumulative.fraction == cumulative.fraction[-1])


def systematic(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Systematic resampling.

    Args:
        rng_key: PRNG key.
        log_weights: Unnormalised log-weights (N,).
        num: Number of ancestors to draw.

    Returns:
        Ancestors (num,), int32, ascending.
    """
    return _systematic(rng_key, _weights(log_weights), num, num)


def systematic_draws(rng_keys: Array, log_weights: Array, nums: Sequence[int]) -> list[Array]:
    """Systematic resampling of one set (N,) to several numbers, each with a key of its own; compiled as one."""
    most = max(nums)
    weights, numbers = _weights(log_weights), jnp.asarray(nums, log_weights.dtype)
    drawn = jax.vmap(partial(_systematic, weights=weights, most=most))(rng_keys, num=numbers)
    return [ancestors[:num] for ancestors, num in zip(drawn, nums, strict=True)]


def _systematic(rng_key: Array, weights: Array, num: Any, most: int) -> Array:
    """Ancestors (most,), of which the first `num` count."""
    cumulative = _cumulative(_expected_children(weights, num), most)
    offset = jax.random.uniform(rng_key, dtype=weights.dtype) / unit(weights.dtype)
    return _share_slots(cumulative, cumulative.whole + (cumulative.fraction > offset), most)


def stratified(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Stratified resampling; arguments and result as in `systematic`."""
    ends = _cumulative(_expected_children(_weights(log_weights), num), num)
    offsets = jax.random.uniform(rng_key, (num,), log_weights.dtype) / unit(log_weights.dtype)
    own = offsets[jnp.clip(ends.whole.astype(jnp.int32), 0, num - 1)]
    return _share_slots(ends, ends.whole + (ends.fraction > own), num)


def multinomial(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Multinomial resampling: independent draws, in no order; arguments and result as in `systematic`."""
    return _draw_independently(rng_key, _expected_children(_weights(log_weights), num), num)


def residual(rng_key: Array, log_weights: Array, num: int) -> Array:
    """Residual resampling: the sure children first, in order, then the drawn ones; otherwise as `systematic`."""
    expected = _expected_children(_weights(log_weights), num)
    sure = jnp.floor(expected)
    ends = running_sum(sure)
    rest = expected - sure
    total = jnp.sum(rest)
    scaled = jnp.where(total > 0, rest * (num / jnp.where(total > 0, total, 1.0)), expected)
    drawn = _draw_independently(rng_key, scaled, num)
    copied = _share_slots(Split(ends, jnp.zeros_like(ends)), ends, num)
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
    return jnp.searchsorted(jnp.where(_complete(cumulative), jnp.uint32(2**32 - 1), ends), drawn, side="right").astype(
        jnp.int32
    )


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
