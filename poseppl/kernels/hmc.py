"""Parallel hybrid Monte Carlo chains on one density, with BlackJAX's kernel (Choo and Fleet 2001, section 6).

All M chains share the step size, which is adapted to a target acceptance rate during the warm-up and frozen before the draws
that count; positions are those of coordinates in which the mass matrix is the identity (see :mod:`poseppl.kernels.laplace`),
which is the same as the paper's step size per coordinate, Eq. 17.

The recursion of the step size is not BlackJAX's dual averaging. After a warm-up of 6 updates, dual averaging is nearer to the
target if the initial step size is right or too small. It is farther if the initial step size is three times too large, at which
chains hardly move (``python -m benchmarks.blackjax_pieces``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from blackjax.mcmc import integrators, metrics
from blackjax.mcmc.hmc import HMCState, hmc_proposal
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_fraction
from poseppl.compilation import with_full_precision
from poseppl.kernels.own_kernel import CustomKernel, Updated, update_by
from poseppl.particles.keys import normals_and_uniforms
from poseppl.particles.weights import nan_to_neg_inf

LogDensity = Callable[[Array], Array]

_GAIN = 1.0
"""Gain of the first step of the Robbins-Monro recursion on the log step size; it falls as 1 / sqrt(update)."""

_DIVERGENT = 1000.0
"""Loss of energy beyond which an update counts as divergent, as in BlackJAX."""


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
        own: A custom kernel in place of HMC, which reads neither L nor the jitter.
    """

    num_updates: int = 32
    num_leapfrog: int = 40
    num_warmup: int = 6
    step_size: float = 0.5
    target_acceptance: float | None = 0.85
    jitter: float = 0.0
    own: CustomKernel | None = None

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

    draws: Array
    acceptance: Array
    divergences: Array
    log_step_size: Array
    num_gradient: Array


@with_full_precision
def hmc_chains(
    rng_key: Array,
    starts: Array,
    log_density: LogDensity,
    log_step_size: Array,
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
    dtype, number = starts.dtype, settings.num_updates

    def safe_density(position: Array) -> Array:
        return nan_to_neg_inf(log_density(position))

    if settings.own is not None:
        return _own_chains(settings.own, rng_key, starts, safe_density, jnp.asarray(log_step_size, dtype), settings)

    def update(carry: Any, row: tuple[Array, ...]) -> tuple[Any, Any]:
        states, log_step_size = carry
        number, noise, chances, steps = row
        # the first update stays where it is: the gradient at the starts, without compiling it a second time
        step_size = jnp.where(number < 0, 0.0, jnp.exp(log_step_size))
        states, info = jax.vmap(_move(safe_density, dimension, step_size, steps))(states, noise, chances)
        acceptance = jnp.mean(info.acceptance_rate)
        log_step_size = adapted_step_size(log_step_size, acceptance, number, settings)
        return (states, log_step_size), (states.position, acceptance, jnp.sum(info.is_divergent), steps)

    noise, chances = normals_and_uniforms(rng_key, (number + 1, num_chains), dimension, 2, dtype)
    steps = _trajectory_lengths(chances[:, 0, 1], settings).at[0].set(1)
    unknown = HMCState(starts, jnp.full(num_chains, -jnp.inf, dtype), jnp.zeros_like(starts))
    carry, (positions, acceptance, divergent, steps) = jax.lax.scan(
        update,
        (unknown, jnp.asarray(log_step_size, dtype)),
        (jnp.arange(-1, number), noise, chances[:, :, 0], steps),
    )
    kept = slice(1 + settings.num_warmup, None)
    return Chains(
        draws=jnp.swapaxes(positions[kept], 0, 1),
        acceptance=jnp.mean(acceptance[kept]),
        divergences=jnp.sum(divergent[kept]).astype(jnp.int32),
        log_step_size=carry[1],
        num_gradient=(num_chains * jnp.sum(steps)).astype(jnp.int32),
    )


def _own_chains(
    own: CustomKernel, rng_key: Array, starts: Array, log_density: LogDensity, log_step_size: Array, settings: HMCSettings
) -> Chains:
    """The same with a custom kernel, which draws its own random numbers."""
    num_chains = len(starts)

    def update(carry: Any, row: tuple[Array, Array]) -> tuple[Any, Any]:
        states, log_step_size = carry
        number, rng_key = row

        def one(key: Array, state: Any) -> Updated:
            return update_by(own, key, state, log_density, jnp.exp(log_step_size))

        found = jax.vmap(one)(jax.random.split(rng_key, num_chains), states)
        outputs = found.state.position, found.acceptance, found.divergent, found.evaluations
        return (found.state, adapted_step_size(log_step_size, jnp.mean(found.acceptance), number, settings)), outputs

    states = jax.vmap(lambda position: own.init(position, log_density))(starts)
    rows = jnp.arange(settings.num_updates), jax.random.split(rng_key, settings.num_updates)
    (_, log_step_size), (positions, acceptance, divergent, count) = jax.lax.scan(update, (states, log_step_size), rows)
    kept = slice(settings.num_warmup, None)
    return Chains(
        draws=jnp.swapaxes(positions[kept], 0, 1),
        acceptance=jnp.nan_to_num(jnp.mean(acceptance[kept]), nan=1.0),
        divergences=jnp.sum(divergent[kept]).astype(jnp.int32),
        log_step_size=log_step_size,
        num_gradient=(num_chains + jnp.sum(count)).astype(jnp.int32),
    )


def adapted_step_size(log_step_size: Array, acceptance: Array, number: Array, settings: HMCSettings) -> Array:
    """The log step size after the update of a number, from -1 on; unchanged if the acceptance rate is unknown (NaN)."""
    if settings.target_acceptance is None:
        return log_step_size
    error = jnp.where(jnp.isnan(acceptance), 0.0, acceptance - settings.target_acceptance)
    counts = (number >= 0) & (number < settings.num_warmup)
    gain = jnp.where(counts, _GAIN / jnp.sqrt(number + 1.0), 0.0)
    return log_step_size + (gain * error).astype(log_step_size.dtype)


def _move(density: LogDensity, dimension: int, step_size: Array, steps: Array) -> Callable[..., Any]:
    """`(state, noise (d,), chance) -> (state, info)`: BlackJAX's update, which draws no numbers of its own."""
    metric = metrics.default_metric(jnp.ones(dimension))
    integrator = integrators.velocity_verlet(density, metric.kinetic_energy)

    def accept(chance: Array, log_ratio: Array, state: Any, proposal: Any) -> Any:
        rate = jnp.minimum(jnp.exp(log_ratio), 1.0)
        accepted = chance < rate
        chosen = jax.tree.map(lambda new, old: jnp.where(accepted, new, old), proposal, state)
        return chosen, (accepted, rate, None)

    update = hmc_proposal(integrator, metric.kinetic_energy, step_size, steps, _DIVERGENT, sample_proposal=accept)

    def move(state: HMCState, noise: Array, chance: Array) -> Any:
        position, value, gradient = state
        moved, info, _ = update(chance, integrators.IntegratorState(position, noise, value, gradient))
        return HMCState(moved.position, moved.logdensity, moved.logdensity_grad), info

    return move


def _trajectory_lengths(chances: Array, settings: HMCSettings) -> Array:
    """L of each update, int32, from uniform numbers in [0, 1)."""
    shortest = max(1, round((1.0 - settings.jitter) * settings.num_leapfrog))
    return (shortest + jnp.floor(chances * (settings.num_leapfrog + 1 - shortest))).astype(jnp.int32)
