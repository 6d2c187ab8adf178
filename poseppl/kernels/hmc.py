"""Parallel hybrid Monte Carlo chains on one density, with BlackJAX's kernel (Choo and Fleet 2001, section 6).

All M chains share the step size, which is adapted to a target acceptance rate during the warm-up and frozen before the draws
that count; positions are those of coordinates in which the mass matrix is the identity (see :mod:`poseppl.kernels.laplace`),
which is the same as the paper's step size per coordinate, Eq. 17.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import blackjax
import jax
import jax.numpy as jnp

from poseppl.checks import RangeError, check_at_least, check_fraction

_GAIN = 1.0
"""Gain of the first step of the Robbins-Monro recursion on the log step size; it falls as 1 / sqrt(update)."""


class HMCSettings(NamedTuple):
    """Settings of a set of chains, in the paper's letters where it has them.

    Attributes:
        num_updates: R, HMC updates of each chain and frame, warm-up included.
        num_leapfrog: L, leapfrog steps an update.
        num_warmup: b, updates whose draws are discarded; the step size adapts only during these.
        step_size: epsilon, the step size adjustment factor; where it adapts, its value at the first frame.
        target_acceptance: Acceptance rate that the step size is adapted to, 1 less the paper's rejection rate; None keeps
            it fixed.
        jitter: Fraction by which L is shortened at random, the same for all chains of an update: L is uniform on
            [ceil((1 - jitter) L), L]. 0 keeps it fixed.
    """

    num_updates: int = 32
    num_leapfrog: int = 40
    num_warmup: int = 6
    step_size: float = 0.5
    target_acceptance: float | None = 0.85
    jitter: float = 0.0

    def check(self) -> HMCSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(1, num_updates=self.num_updates, num_leapfrog=self.num_leapfrog)
        if not 0 <= self.num_warmup < self.num_updates:
            raise RangeError("num_warmup", self.num_warmup, f"0 to num_updates - 1 = {self.num_updates - 1}")
        if not self.step_size > 0:
            raise RangeError("step_size", self.step_size, "a positive number")
        if self.target_acceptance is not None:
            check_fraction("(0, 1)", target_acceptance=self.target_acceptance)
        check_fraction("[0, 1)", jitter=self.jitter)
        return self


class Chains(NamedTuple):
    """Result of M chains of R updates.

    Attributes:
        draws: Positions after the warm-up, shape (M, R - b, d).
        acceptance: Mean acceptance probability of the draws that count.
        divergences: How many updates after the warm-up diverged, of all chains.
        log_step_size: The frozen log step size.
        num_gradient: Evaluations of the density's gradient, all chains together.
    """

    draws: jax.Array
    acceptance: jax.Array
    divergences: jax.Array
    log_step_size: jax.Array
    num_gradient: jax.Array


def hmc_chains(
    rng_key: jax.Array,
    starts: jax.Array,
    log_density: Callable[[jax.Array], jax.Array],
    log_step_size: jax.Array,
    settings: HMCSettings,
) -> Chains:
    """Run M chains side by side.

    Args:
        rng_key: PRNG key.
        starts: Starting positions (M, d).
        log_density: Unnormalised log-density of one position (d,), a scalar; NaN counts as -inf.
        log_step_size: Log step size to start from.
        settings: L, R, b and so on.

    Returns:
        The draws after the warm-up and how it went.
    """
    num_chains, dimension = starts.shape
    kernel: Callable[..., Any] = blackjax.hmc.build_kernel()
    mass = jnp.ones(dimension, starts.dtype)

    def safe_density(position: jax.Array) -> jax.Array:
        value = log_density(position)
        return jnp.where(jnp.isnan(value), -jnp.inf, value)

    def update(carry: Any, inputs: tuple[jax.Array, jax.Array]) -> tuple[Any, Any]:
        states, log_step_size = carry
        key, number = inputs
        key_length, key_chains = jax.random.split(key)
        steps = _trajectory_length(key_length, settings)
        step_size = jnp.exp(log_step_size)

        def move(key: jax.Array, state: Any) -> Any:
            return kernel(key, state, safe_density, step_size, mass, steps)

        states, info = jax.vmap(move)(jax.random.split(key_chains, num_chains), states)
        acceptance = jnp.mean(info.acceptance_rate)
        if settings.target_acceptance is not None:
            error = acceptance - settings.target_acceptance
            gain = jnp.where(number < settings.num_warmup, _GAIN / jnp.sqrt(number + 1.0), 0.0)
            log_step_size = log_step_size + (gain * error).astype(log_step_size.dtype)
        return (states, log_step_size), (states.position, acceptance, jnp.sum(info.is_divergent), steps)

    states = jax.vmap(lambda start: blackjax.hmc.init(start, safe_density))(starts)
    keys = jax.random.split(rng_key, settings.num_updates)
    carry, (positions, acceptance, divergent, steps) = jax.lax.scan(
        update, (states, jnp.asarray(log_step_size, starts.dtype)), (keys, jnp.arange(settings.num_updates))
    )
    kept = slice(settings.num_warmup, None)
    return Chains(
        draws=jnp.swapaxes(positions[kept], 0, 1),
        acceptance=jnp.mean(acceptance[kept]),
        divergences=jnp.sum(divergent[kept]).astype(jnp.int32),
        log_step_size=carry[1],
        num_gradient=(num_chains * (1 + jnp.sum(steps))).astype(jnp.int32),
    )


def _trajectory_length(rng_key: jax.Array, settings: HMCSettings) -> Any:
    shortest = max(1, round((1.0 - settings.jitter) * settings.num_leapfrog))
    if shortest == settings.num_leapfrog:
        return settings.num_leapfrog
    return jax.random.randint(rng_key, (), shortest, settings.num_leapfrog + 1)
