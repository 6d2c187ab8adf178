r"""Resampling: draw ancestors so that particle i has e_i = num * w_i children on average.

Every scheme is unbiased, E[children of i] = e_i, and they differ in the spread. With C_i = e_1 + ... + e_i and the slots
k = 0, ..., num - 1,

* multinomial: num independent draws;
* residual: floor(e_i) children for sure, the rest multinomial (Liu and Chen 1998, doi:10.1080/01621459.1998.10473765);
* stratified: slot k takes the particle that owns k + u_k, C_(i-1) <= k + u_k < C_i (Kitagawa 1996, doi:10.2307/1390750);
* systematic: the same with one u for all slots.

Douc, Cappe and Moulines 2005 (doi:10.1109/ISPA.2005.195385) compare them. Ancestors of all but multinomial come out in order.

In float32, C_i near N = 100,000 would have 7 bits left of the unit that decides. Here C_i = I_i + R_i, with I_i the exact
integer sum of the rounded e_i and R_i the sum of the small remainders, so that decisions keep their precision at any N; uniform
weights give R_i = 0, and every particle exactly one child. Slots are shared out by a scatter and a running maximum, without a
sort or a search. Particles of zero (or NaN) weight never have children; if no weight is left, all count alike (see
`weights.normalise`).

Example:
    >>> systematic(jax.random.key(0), jnp.log(jnp.array([0.5, 0.0, 0.25, 0.25])), 4).tolist()
    [0, 0, 2, 3]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from poseppl.running import running_maximum, running_sum

Resampling = Callable[[jax.Array, jax.Array, int], jax.Array]


class _Cumulative(NamedTuple):
    """C_i split into whole part and fraction in [0, 1), and which particles have weight at all; each (N,)."""

    whole: jax.Array
    fraction: jax.Array
    alive: jax.Array


def _expected_children(log_weights: jax.Array, num: int) -> jax.Array:
    """e_i = num * w_i (N,), which add up to num beyond the precision of one sum."""
    clean = jnp.where(jnp.isnan(log_weights), -jnp.inf, log_weights)
    peak = jnp.max(clean)
    weights = jnp.where(jnp.isfinite(peak), jnp.exp(clean - jnp.where(jnp.isfinite(peak), peak, 0.0)), 1.0)
    expected = weights * (num / jnp.sum(weights))
    nearest = jnp.round(expected)
    excess = (jnp.sum(nearest.astype(jnp.int32)) - num).astype(expected.dtype) + jnp.sum(expected - nearest)
    return expected * (1.0 - excess / num)


def _cumulative(expected: jax.Array) -> _Cumulative:
    nearest = jnp.round(expected)
    remainder = running_sum(expected - nearest)
    below = jnp.floor(remainder)
    whole = running_sum(nearest.astype(jnp.int32)) + below.astype(jnp.int32)
    return _Cumulative(whole, remainder - below, expected > 0)


def _share_slots(ends: jax.Array, alive: jax.Array, num: int) -> jax.Array:
    """Ancestors (num,) int32, when particle i owns the slots from the end of particle i - 1 up to `ends[i]` (N,)."""
    starts = jnp.concatenate([jnp.zeros(1, ends.dtype), ends[:-1]])
    indices = jnp.where(alive, jnp.arange(ends.shape[0], dtype=jnp.int32), 0)
    first = jnp.zeros(num, jnp.int32).at[starts].max(indices, mode="drop")
    return running_maximum(first)


def systematic(rng_key: jax.Array, log_weights: jax.Array, num: int) -> jax.Array:
    """Systematic resampling.

    Args:
        rng_key: PRNG key.
        log_weights: Unnormalised log-weights (N,).
        num: Number of ancestors to draw.

    Returns:
        Ancestors (num,), int32, ascending.
    """
    whole, fraction, alive = _cumulative(_expected_children(log_weights, num))
    offset = jax.random.uniform(rng_key, dtype=fraction.dtype)
    return _share_slots(whole + (fraction > offset), alive, num)


def stratified(rng_key: jax.Array, log_weights: jax.Array, num: int) -> jax.Array:
    """Stratified resampling; arguments and result as in `systematic`."""
    whole, fraction, alive = _cumulative(_expected_children(log_weights, num))
    offsets = jax.random.uniform(rng_key, (num,), fraction.dtype)
    return _share_slots(whole + (fraction > offsets[jnp.clip(whole, 0, num - 1)]), alive, num)


def multinomial(rng_key: jax.Array, log_weights: jax.Array, num: int) -> jax.Array:
    """Multinomial resampling: independent draws, in no order; arguments and result as in `systematic`."""
    return _draw_independently(rng_key, _expected_children(log_weights, num), num)


def residual(rng_key: jax.Array, log_weights: jax.Array, num: int) -> jax.Array:
    """Residual resampling: the sure children first, in order, then the drawn ones; otherwise as `systematic`."""
    expected = _expected_children(log_weights, num)
    sure = jnp.floor(expected)
    ends = running_sum(sure.astype(jnp.int32))
    rest = expected - sure
    total = jnp.sum(rest)
    scaled = jnp.where(total > 0, rest * (num / jnp.where(total > 0, total, 1.0)), expected)
    drawn = _draw_independently(rng_key, scaled, num)
    copied = _share_slots(ends, sure > 0, num)
    return jnp.where(jnp.arange(num) < ends[-1], copied, drawn)


def _draw_independently(rng_key: jax.Array, expected: jax.Array, num: int) -> jax.Array:
    """Ancestors (num,) drawn independently in proportion to `expected` (N,), whose sum is num.

    Slot and position in the slot are drawn and compared in fixed point of 32 bits, 15 of them after the point at 100,000.
    """
    cumulative = _cumulative(expected)
    bits = 32 - int(num).bit_length()
    scale = jnp.asarray(2**bits, cumulative.fraction.dtype)
    point = jnp.minimum((cumulative.fraction * scale).astype(jnp.uint32), jnp.uint32(2**bits - 1))
    ends = (jnp.clip(cumulative.whole, 0, num).astype(jnp.uint32) << bits) + point
    ends = running_maximum(jnp.where(cumulative.alive, ends, jnp.uint32(0)))
    key_slot, key_point = jax.random.split(rng_key)
    slots = jax.random.randint(key_slot, (num,), 0, num).astype(jnp.uint32)
    drawn = (slots << bits) + (jax.random.bits(key_point, (num,), jnp.uint32) >> (32 - bits))
    last = jnp.max(jnp.where(cumulative.alive, jnp.arange(expected.shape[0], dtype=jnp.int32), 0))
    return jnp.minimum(jnp.searchsorted(ends, drawn, side="right").astype(jnp.int32), last)


SCHEMES: dict[str, Resampling] = {
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
    "multinomial": multinomial,
}


def resampling_scheme(name: str) -> Resampling:
    """The scheme of a name.

    Raises:
        ValueError: An unknown name.
    """
    if name not in SCHEMES:
        raise ValueError(f"resampling is {name!r}. Expected one of {', '.join(SCHEMES)}.")
    return SCHEMES[name]


def resample(rng_key: jax.Array, log_weights: jax.Array, num: int, scheme: str = "systematic") -> jax.Array:
    """Ancestors (num,) int32 by the scheme of a name.

    Raises:
        ValueError: An unknown name.
    """
    return resampling_scheme(scheme)(rng_key, log_weights, num)
