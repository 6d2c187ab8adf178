"""Resampling: draw ancestors so that particle i has e_i = num * w_i children on average.

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

The running sums are exact and fast. XLA's own cumulative operations are log-depth trees, which a CPU runs slowly. Here a
vector is cut into rows of 16, each row times a triangular matrix of ones is its running sum, and the rows' totals are summed
in the same way: the work is one thin matrix product, at the speed of reading and writing. Few totals are summed at once, each
from all before it, for each level takes its time to compile.

The numbers are integers stored as floats, so sums are exact below 2^24 in float32. Longer numbers come in two parts, a whole
one and a fraction in units of 2^-20 (2^-49 in float64), and each level carries from the second into the first: sums keep 20
bits after the point at any length, and entries of zero change nothing, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_choice
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


_ROW, _FEW = 16, 32


class Split(NamedTuple):
    """Numbers in two parts of one shape: integers, and integer multiples of the :func:`unit`."""

    whole: Array
    fraction: Array


def unit(dtype: np.dtype[Any]) -> float:
    """Value of a fraction of 1: the largest power of 2 of which sums of a row are exact, inverted."""
    return float(2.0 ** -_bits(dtype))


def _bits(dtype: np.dtype[Any]) -> int:
    """Digits of a fraction, after the point."""
    return int(np.finfo(dtype).nmant) - 3


def split_number(x: Array) -> Split:
    """Split numbers into the nearest integer and the rest."""
    whole = jnp.round(x)
    return Split(whole, jnp.round((x - whole) / unit(x.dtype)))


def largest_sum(dtype: np.dtype[Any]) -> int:
    """Up to where sums are exact."""
    return int(2 ** (np.finfo(dtype).nmant + 1))


def running_sum(x: Array) -> Array:
    """Sums of the first 1, 2, ..., N of integers (N,) stored as floats."""
    if x.shape[0] <= _FEW:
        return _at_once(x)
    rows = _rows(x)
    within = _product(rows)
    before = _shifted(running_sum(within[:, -1]))
    return (within + before[:, None]).reshape(-1)[: x.shape[0]]


def running_split_sum(x: Split) -> Split:
    """Running sums of split numbers; fractions of the sums lie in [0, 1)."""
    if x.whole.shape[0] <= _FEW:
        # so many fractions have sums of more bits than a float's
        whole, fraction = _at_once(jnp.stack([x.whole, x.fraction]).astype(int))
        over = fraction >> _bits(x.whole.dtype)
        rest = fraction - (over << _bits(x.whole.dtype))
        return Split((whole + over).astype(x.whole.dtype), rest.astype(x.whole.dtype))
    within = _carry(*_product(jnp.stack([_rows(x.whole), _rows(x.fraction)])))
    totals = running_split_sum(Split(within.whole[:, -1], within.fraction[:, -1]))
    whole = within.whole + _shifted(totals.whole)[:, None]
    fraction = within.fraction + _shifted(totals.fraction)[:, None]
    size = x.whole.shape[0]
    return _carry(whole.reshape(-1)[:size], fraction.reshape(-1)[:size])


def _at_once(x: Array) -> Array:
    """Running sums along the last axis, each on its own."""
    return jnp.sum(jnp.where(np.tri(x.shape[-1], dtype=bool), x[..., None, :], 0), -1)


def _rows(x: Array) -> Array:
    rows = -(-x.shape[0] // _ROW)
    return jnp.pad(x, (0, rows * _ROW - x.shape[0])).reshape(rows, _ROW)


def _product(rows: Array) -> Array:
    triangle = jnp.asarray(np.triu(np.ones((_ROW, _ROW))), rows.dtype)
    return jnp.matmul(rows, triangle, precision=jax.lax.Precision.HIGHEST)


def _shifted(totals: Array) -> Array:
    return jnp.concatenate([jnp.zeros(1, totals.dtype), totals[:-1]])


def _carry(whole: Array, fraction: Array) -> Split:
    step = unit(fraction.dtype)
    over = jnp.floor(fraction * step)
    return Split(whole + over, fraction - over / step)
