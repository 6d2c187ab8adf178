r"""Differential evolution Markov chains (DE-MC): a population that takes its steps from its own differences.

Section 2.2 of Du and Guan 2006 (Monocular human motion tracking with the DE-MC particle filter, ICASSP), after ter Braak 2006
(doi:10.1007/s11222-006-8769-1). A member moves by the difference of two others and a small symmetric noise (Eq. 6), and keeps
the new place by the rule of Metropolis:

    x* = x + lambda (y_r1 - y_r2) + g,    lambda = (1 - c) 2.38 / sqrt(2 d),    g ~ U(-c sigma, c sigma),

sigma the standard deviations of the population. So steps have the scale and the correlations of the density, and its modes are
linked by the differences between members in several of them.

Moved all at once by the differences of the population as it was, members would not keep the density: the pool that a member's
step is drawn from must not change while the member moves. Here each half of the population moves by the other half's
differences, which keeps the product of the members' densities exactly, for any number of members.

Variants of ter Braak and Vrugt 2008 (doi:10.1007/s11222-008-9104-9):

* snooker: x* = x + gamma e e^T (y_r1 - y_r2), with e the direction from a third member z to x, gamma ~ U(1.2, 2.2), and the
  acceptance ratio multiplied by (|x* - z| / |x - z|)^(d - 1);
* past states (DE-MCzs): the pool is every state that any member was in so far, and all members move at once. It is exact only
  in the limit of many updates, as the pool changes less and less.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_fraction
from poseppl.compilation import with_full_precision
from poseppl.particles.weights import without_infinity

LogDensity = Callable[[Array], Array]

_SNOOKER = (1.2, 2.2)
"""Range of the snooker's gamma."""


class DEMCSettings(NamedTuple):
    """Settings of a population.

    Attributes:
        num_updates: R, updates of each member, warm-up included.
        num_warmup: b, updates whose draws are discarded.
        noise: c, half-width of the noise in standard deviations of the pool, in [0, 1).
        scale: lambda; None is (1 - c) 2.38 / sqrt(2 d).
        jump: Probability that an update takes lambda = 1, from mode to mode.
        snooker: Probability that a member makes a snooker update.
        past_states: Whether differences are those of past states.
    """

    num_updates: int = 30
    num_warmup: int = 0
    noise: float = 0.05
    scale: float | None = None
    jump: float = 0.0
    snooker: float = 0.0
    past_states: bool = False

    def check(self) -> DEMCSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(1, num_updates=self.num_updates)
        if not 0 <= self.num_warmup < self.num_updates:
            raise RangeError("num_warmup", self.num_warmup, f"0 to num_updates - 1 = {self.num_updates - 1}")
        check_fraction("[0, 1)", noise=self.noise)
        if self.scale is not None and not self.scale > 0:
            raise RangeError("scale", self.scale, "a positive number, or None")
        check_fraction("[0, 1]", jump=self.jump, snooker=self.snooker)
        return self


class Members(NamedTuple):
    """Positions (N, d) of a population, and their log-densities (N,)."""

    positions: Array
    values: Array


class DEMCChains(NamedTuple):
    """Result of N members of R updates.

    Attributes:
        draws: Positions after the warm-up (N, R - b, d).
        values: Their log-densities (N, R - b).
        acceptance: Mean acceptance probability of the draws that count.
        num_density: Evaluations of the density, int32.
    """

    draws: Array
    values: Array
    acceptance: Array
    num_density: Array


@with_full_precision
def demc_chains(
    rng_key: Array,
    starts: Array,
    log_density: LogDensity,
    settings: DEMCSettings,
    min_noise: Array | float = 0.0,
) -> DEMCChains:
    """Run a population.

    Args:
        rng_key: PRNG key.
        starts: Starting positions (N, d).
        log_density: Unnormalised log-density of one position (d,), a scalar; NaN counts as -inf.
        settings: R, b, c and so on.
        min_noise: Half-width of the noise at least, a scalar or (d,), in the state's units: members that start all in one
            place have no differences.
    """
    number, dimension = starts.shape
    settings = settings.check()

    def update(carry: tuple[Members, Array], item: tuple[Array, Array]) -> tuple[Any, Any]:
        members, archive = carry
        rng_key, turn = item
        if settings.past_states:
            pool = archive.reshape(-1, dimension)
            known = jnp.arange(pool.shape[0]) < number * (turn + 1)
            noise = jnp.maximum(settings.noise * jnp.std(pool, 0, where=known[:, None]), min_noise)
            members, rate = move_members(rng_key, members, pool, number * (turn + 1), log_density, settings, noise)
            archive = archive.at[turn + 1].set(members.positions)
        else:
            members, rate = demc_update(rng_key, members, log_density, settings, min_noise=min_noise)
        return (members, archive), (members, rate)

    rows = settings.num_updates + 1 if settings.past_states else 1
    archive = jnp.zeros((rows, number, dimension), starts.dtype).at[0].set(starts)
    keys = jax.random.split(rng_key, settings.num_updates)
    start = Members(starts, _values(starts, log_density))
    _, (found, rates) = jax.lax.scan(update, (start, archive), (keys, jnp.arange(settings.num_updates)))
    kept = slice(settings.num_warmup, None)
    return DEMCChains(
        draws=jnp.swapaxes(found.positions[kept], 0, 1),
        values=jnp.swapaxes(found.values[kept], 0, 1),
        acceptance=jnp.mean(rates[kept]),
        num_density=jnp.int32(number * (1 + settings.num_updates)),
    )


def demc_update(
    rng_key: Array,
    members: Members,
    log_density: LogDensity,
    settings: DEMCSettings,
    *,
    noise_factor: Array | float = 1.0,
    noise_scale: Array | None = None,
    min_noise: Array | float = 0.0,
) -> tuple[Members, Array]:
    """Move every member once, each half by the differences of the other.

    Args:
        rng_key: PRNG key.
        members: The population.
        log_density: Log-density of one position.
        settings: c, lambda and so on.
        noise_factor: Multiplies the noise.
        noise_scale: sigma (d,) in place of the pool's standard deviations.
        min_noise: The noise's half-width is at least this, a scalar or (d,).

    Returns:
        The population, and its mean acceptance probability.
    """
    number = members.values.shape[0]
    keys = jax.random.split(rng_key)

    def move(rng_key: Array, some: Members, pool: Array) -> tuple[Members, Array]:
        sigma = jnp.std(pool, 0) if noise_scale is None else noise_scale
        noise = jnp.maximum(noise_factor * settings.noise * sigma, min_noise)
        return move_members(rng_key, some, pool, pool.shape[0], log_density, settings, noise)

    if number == 1:
        return move(keys[0], members, members.positions)
    first, second = (jax.tree.map(lambda leaf, start=start: leaf[start::2], members) for start in (0, 1))
    first, first_rate = move(keys[0], first, second.positions)
    second, second_rate = move(keys[1], second, first.positions)
    joined = jax.tree.map(lambda whole, a, b: whole.at[0::2].set(a).at[1::2].set(b), members, first, second)
    share = first.values.shape[0] / number
    return joined, share * first_rate + (1.0 - share) * second_rate


@with_full_precision
def move_members(
    rng_key: Array,
    members: Members,
    pool: Array,
    num_pool: Array | int,
    log_density: LogDensity,
    settings: DEMCSettings,
    noise: Array,
) -> tuple[Members, Array]:
    """Move members once by the differences of a pool; exact as long as the pool does not depend on them.

    Args:
        rng_key: PRNG key.
        members: Those to move.
        pool: Positions (M, d), of which the first `num_pool` count.
        num_pool: How many; with fewer than two there are no differences.
        log_density: Log-density of one position.
        settings: lambda, probabilities of variants.
        noise: Half-width of the noise, a scalar or (d,).

    Returns:
        The members, and their mean acceptance probability.
    """
    count, dimension = members.positions.shape
    scale = (1.0 - settings.noise) * 2.38 / (2 * dimension) ** 0.5 if settings.scale is None else settings.scale

    def propose(x: Array, choices: Array, shake: Array) -> tuple[Array, Array]:
        first, second, third = pool[_three_indices(choices[:3], num_pool)]
        leap = jnp.where(choices[3] < settings.jump, 1.0, scale)
        straight = x + leap * (first - second) + shake
        if settings.snooker == 0:
            return straight, jnp.zeros((), x.dtype)
        low, high = _SNOOKER
        bent, log_factor = _snooker(x, third, (low + (high - low) * choices[4]) * (first - second))
        chosen = choices[5] < settings.snooker
        return jnp.where(chosen, bent, straight), jnp.where(chosen, log_factor, 0.0)

    key_choices, key_noise = jax.random.split(rng_key)
    choices = jax.random.uniform(key_choices, (count, 7), members.positions.dtype)
    shakes = symmetric_noise(key_noise, noise, members.positions)
    proposals, log_factors = jax.vmap(propose)(members.positions, choices, shakes)
    values = _values(proposals, log_density)
    # a member without density goes anywhere that has some
    ratio = jnp.where(jnp.isneginf(members.values), 0.0, values - members.values + log_factors)
    rates = jnp.where(jnp.isneginf(values), 0.0, jnp.exp(jnp.minimum(ratio, 0.0)))
    accept = choices[:, 6] < rates
    positions = jnp.where(accept[:, None], proposals, members.positions)
    return Members(positions, jnp.where(accept, values, members.values)), jnp.mean(rates)


def symmetric_noise(rng_key: Array, half_width: Array, x: Array) -> Array:
    """Uniform noise around zero for positions (N, d), of half-width a scalar or (d,)."""
    return half_width * jax.random.uniform(rng_key, x.shape, x.dtype, -1.0, 1.0)


def _values(positions: Array, log_density: LogDensity) -> Array:
    return without_infinity(jax.vmap(log_density)(positions))


def _three_indices(uniforms: Array, count: Array | int) -> Array:
    """Three different indices below `count` (3,), as far as there are three, from uniforms (3,) in [0, 1)."""
    choices = jnp.maximum(count - jnp.arange(3), 1)
    first, second, third = jnp.minimum((uniforms * choices).astype(jnp.int32), choices - 1)
    second = jnp.where(second >= first, second + 1, second)
    low, high = jnp.minimum(first, second), jnp.maximum(first, second)
    third = jnp.where(third >= low, third + 1, third)
    third = jnp.where(third >= high, third + 1, third)
    return jnp.stack([first, second, third]) % count


def _snooker(x: Array, centre: Array, step: Array) -> tuple[Array, Array]:
    """The snooker proposal along the line from `centre` to x (d,), and the log of its factor in the acceptance ratio."""
    line = x - centre
    distance = jnp.linalg.norm(line)
    apart = distance > 0
    safe = jnp.where(apart, distance, 1.0)
    direction = line / safe
    # on the line, a signed coordinate from the centre: the step may cross it
    along = safe + direction @ step
    proposal = jnp.where(apart, x + (direction @ step) * direction, x)
    log_factor = (x.shape[0] - 1) * (jnp.log(jnp.abs(along)) - jnp.log(safe))
    return proposal, jnp.where(apart, log_factor, 0.0)
