r"""Moves of a whole population, each member on a density of its own, scaled by what the population shows.

Member i has a position x_i and a context c_i. It moves on p(x | c_i) with BlackJAX's HMC or random walk or a custom kernel
(:mod:`poseppl.kernels.own_kernel`). The coordinates are whitened for many members together:

* by gradients: E[g g^T] = E[-Hessian of log p], g = grad log p(x | c), when x is drawn from p (integration by parts). So the
  mean outer product of the members' gradients is their mean curvature, without the variance of the contexts;
* by spread, without gradients: the sum of the inverse covariances of the members and of x given c before any data. If both are
  Gaussian, this lies between the curvature and twice the curvature.

The step size is shared, and follows the mean acceptance rate by stochastic approximation. All of this depends on the
population only through averages, whose effect on an estimate vanishes as the population grows; in :func:`move_groups`, for the
scale, through those of other members alone.
"""

from __future__ import annotations

from collections.abc import Callable
from math import gcd
from typing import Any, Literal, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
import numpy as np
from blackjax.mcmc.hmc import HMCState
from blackjax.mcmc.random_walk import RWState, normal
from jax import Array

from poseppl.checks import RangeError, check_at_least, check_choice, check_fraction
from poseppl.compilation import with_full_precision
from poseppl.kernels.laplace import Whitening, whitening
from poseppl.kernels.own_kernel import CustomKernel, Updated, update_by
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf

ConditionalDensity = Callable[[Array, Any], Array]
"""Unnormalised log-density of a position (d,) given a context; NaN counts as -inf."""

GROUPS = 8
"""Number of groups of members at most, each whitened by the others; four where eight do not divide the members, but four do."""
Kernel = Literal["hmc", "random-walk"]


class MoveSettings(NamedTuple):
    """Settings of a population's moves.

    Attributes:
        kernel: "hmc", or "random-walk" for densities without a gradient.
        num_moves: Updates of each member.
        num_leapfrog: L, leapfrog steps of an HMC update.
        step_size: Step size to start from, in whitened coordinates; that of a random walk is multiplied by 2.38 / sqrt(d).
        target_acceptance: Mean acceptance rate that the step size is adapted to; None keeps it fixed.
        jitter: Fraction by which a member's step size is shortened at random in each update, in [0, 1).
        own: A custom kernel in place of `kernel`, which then only determines how the scales of directions are found: "hmc" by
            gradients, "random-walk" by the members' spread.
    """

    kernel: Kernel = "hmc"
    num_moves: int = 2
    num_leapfrog: int = 4
    step_size: float = 0.5
    target_acceptance: float | None = 0.8
    jitter: float = 0.5
    own: CustomKernel | None = None

    def check(self) -> MoveSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_choice(Kernel, kernel=self.kernel)
        check_at_least(1, num_moves=self.num_moves, num_leapfrog=self.num_leapfrog)
        if not self.step_size > 0:
            raise RangeError("step_size", self.step_size, "a positive number")
        if self.target_acceptance is not None:
            check_fraction("(0, 1)", target_acceptance=self.target_acceptance)
        check_fraction("[0, 1)", jitter=self.jitter)
        return self


HMC_MOVES = MoveSettings()
RANDOM_WALK_MOVES = MoveSettings("random-walk", num_moves=20, step_size=1.0, target_acceptance=0.25, jitter=0.0)


class Starts(NamedTuple):
    """Members before they move.

    Attributes:
        positions: Shape (M, d).
        contexts: The arguments of each density, a pytree with a leading axis of M.
        values: Log-densities (M,).
        gradients: Their gradients (M, d); zeros for a random walk.
    """

    positions: Array
    contexts: Any
    values: Array
    gradients: Array


@with_full_precision
def evaluate(positions: Array, contexts: Any, log_density: ConditionalDensity, settings: MoveSettings) -> Starts:
    """Evaluate what the moves start from, at positions (M, d) with contexts (a pytree with a leading axis of M)."""
    if settings.kernel == "random-walk":
        return Starts(positions, contexts, jax.vmap(log_density)(positions, contexts), jnp.zeros_like(positions))
    differentiate: Any = jax.vmap(jax.value_and_grad(log_density))
    return Starts(positions, contexts, *differentiate(positions, contexts))


class Moved(NamedTuple):
    """Result of K updates of M members.

    Attributes:
        positions: After each update (K, M, d).
        acceptance: Mean acceptance rate, a scalar.
        divergences: How many updates diverged, int32.
        log_step_size: The adapted log step size.
        num_density: Evaluations of the density without its gradient, int32.
        num_gradient: Evaluations of its gradient, int32.
    """

    positions: Array
    acceptance: Array
    divergences: Array
    log_step_size: Array
    num_density: Array
    num_gradient: Array


@with_full_precision
def move_population(
    rng_keys: Array,
    starts: Starts,
    log_density: ConditionalDensity,
    transform: Whitening,
    log_step_size: Array,
    settings: MoveSettings,
) -> Moved:
    """Move every member K times.

    Args:
        rng_keys: A key of each member (M,).
        starts: From `evaluate`, for the same density.
        log_density: Log-density of a position and a context.
        transform: To whitened coordinates, the same for all.
        log_step_size: To start from.
        settings: Kernel, K, L and so on.
    """
    (num_members, dimension), dtype = starts.positions.shape, starts.positions.dtype
    kernel = settings.own or KERNELS[settings.kernel](settings, dimension)

    def safe_density(white: Array, context: Any) -> Array:
        return nan_to_neg_inf(log_density(transform.to_state(white), context))

    def chances(rng_key: Array) -> tuple[Array, Array]:
        keys = jax.random.split(rng_key, settings.num_moves + 1)
        return keys[1:], jax.random.uniform(keys[0], (settings.num_moves,), dtype, 1.0 - settings.jitter, 1.0)

    def update(rng_key: Array, state: Any, context: Any, step_size: Array) -> Updated:
        return update_by(kernel, rng_key, state, lambda z: safe_density(z, context), step_size)

    def turn(carry: tuple[Any, Array], row: tuple[Array, Array]) -> tuple[Any, Any]:
        states, log_step_size = carry
        keys, jitter = row
        moved = jax.vmap(update)(keys, states, starts.contexts, jnp.exp(log_step_size) * jitter)
        rate = jnp.mean(moved.acceptance)
        if settings.target_acceptance is not None:
            log_step_size = log_step_size + jnp.where(jnp.isnan(rate), 0.0, rate - settings.target_acceptance)
        statistics = jnp.where(jnp.isnan(rate), 1.0, rate), jnp.sum(moved.divergent), jnp.sum(moved.evaluations)
        return (moved.state, log_step_size), (transform.to_state(moved.state.position), *statistics)

    states = _begin(kernel, starts, transform, safe_density, settings)
    rows = jax.vmap(chances, out_axes=1)(rng_keys)
    (_, log_step_size), (positions, acceptance, divergent, evaluations) = jax.lax.scan(turn, (states, log_step_size), rows)
    hmc, count = settings.kernel == "hmc", num_members + jnp.sum(evaluations)
    return Moved(
        positions=positions,
        acceptance=jnp.mean(acceptance),
        divergences=jnp.sum(divergent).astype(jnp.int32),
        log_step_size=log_step_size,
        num_density=jnp.where(hmc, 0, count).astype(jnp.int32),
        num_gradient=jnp.where(hmc, count, 0).astype(jnp.int32),
    )


def _begin(
    kernel: CustomKernel, starts: Starts, transform: Whitening, log_density: ConditionalDensity, settings: MoveSettings
) -> Any:
    """The kernel's states of all members; of BlackJAX's HMC and random walk without another evaluation."""
    white = transform.to_white(starts.positions)
    if settings.own is not None:
        return jax.vmap(lambda z, context: kernel.init(z, lambda z: log_density(z, context)))(white, starts.contexts)
    values = nan_to_neg_inf(starts.values)
    if settings.kernel == "random-walk":
        return RWState(white, values)
    # the chain rule: z moves x by the scale of the transform
    gradients = starts.gradients * transform.scale if transform.scale.ndim == 1 else starts.gradients @ transform.scale
    return HMCState(white, values, gradients)


@with_full_precision
def move_groups(
    rng_keys: Array,
    starts: Starts,
    log_density: ConditionalDensity,
    whitening_of: Callable[[Starts], Whitening],
    log_step_size: Array,
    settings: MoveSettings,
) -> Moved:
    """Move every member K times, whitened by the members of other groups: neighbours, such as copies, are of one group.

    A scale that depends on a member's own gradient is small where that gradient is steep. Moves then do not leave the density
    invariant; the bias is of order d / M for d coordinates of M members.

    Args:
        rng_keys: A key of each member (M,).
        starts: The M members.
        log_density: Log-density of a position given its context.
        whitening_of: Coordinates that some members call for.
        log_step_size: Log step size to start from; the adapted one is the mean of the groups'.
        settings: Kernel, K, L and so on.
    """
    count = len(starts.positions)
    if count < 2 * GROUPS:
        return move_population(rng_keys, starts, log_density, whitening_of(starts), log_step_size, settings)
    even = gcd(count, GROUPS) > 2  # then nothing is looked up, and each of several devices keeps what it has
    groups = gcd(count, GROUPS) if even else GROUPS
    size = -(-count // groups)
    first = np.arange(groups) * (count - size) // (groups - 1)  # groups overlap where M is no multiple of their number
    others = np.arange(count - size) + size * (np.arange(count - size) >= first[:, None])

    keys, members = jax.tree.map(
        lambda leaf: leaf.reshape(groups, size, *leaf.shape[1:]) if even else leaf[first[:, None] + np.arange(size)],
        (rng_keys, starts),
    )

    def move(keys: Array, members: Starts, others: Array) -> Moved:
        transform = whitening_of(tree_index(starts, others))
        return move_population(keys, members, log_density, transform, log_step_size, settings)

    moved: Moved = jax.vmap(move)(keys, members, jnp.asarray(others))
    positions, group = jnp.swapaxes(moved.positions, 0, 1), np.searchsorted(first, np.arange(count), side="right") - 1
    return Moved(
        positions=positions.reshape(-1, *starts.positions.shape)
        if even
        else positions[:, group, np.arange(count) - first[group]],
        acceptance=jnp.mean(moved.acceptance),
        divergences=jnp.sum(moved.divergences, dtype=jnp.int32),
        log_step_size=jnp.mean(moved.log_step_size),
        num_density=jnp.sum(moved.num_density, dtype=jnp.int32),
        num_gradient=jnp.sum(moved.num_gradient, dtype=jnp.int32),
    )


def _hmc(settings: MoveSettings, dimension: int) -> CustomKernel:
    kernel: Callable[..., Any] = blackjax.hmc.build_kernel()

    def step(rng_key: Array, state: Any, log_density: Callable[[Array], Array], step_size: Array) -> Any:
        return kernel(rng_key, state, log_density, step_size, jnp.ones(dimension, step_size.dtype), settings.num_leapfrog)

    return CustomKernel(blackjax.hmc.init, step)


def _random_walk(settings: MoveSettings, dimension: int) -> CustomKernel:
    kernel: Callable[..., Any] = blackjax.additive_step_random_walk.build_kernel()

    def step(rng_key: Array, state: Any, log_density: Callable[[Array], Array], step_size: Array) -> Any:
        return kernel(rng_key, state, log_density, normal(2.38 / dimension**0.5 * step_size))

    return CustomKernel(blackjax.additive_step_random_walk.init, step)


KERNELS: dict[Kernel, Callable[[MoveSettings, int], CustomKernel]] = {"hmc": _hmc, "random-walk": _random_walk}


@with_full_precision
def whitening_from_gradients(starts: Starts) -> Whitening:
    """Whiten by the mean curvature, estimated by the mean outer product of the members' gradients, where they are finite."""
    count = starts.positions.shape[0]
    finite = jnp.all(jnp.isfinite(starts.gradients), 1, keepdims=True)
    safe = jnp.where(finite, starts.gradients, 0.0)
    return whitening(jnp.mean(starts.positions, 0), _shrink(safe.T @ safe / count, count))


@with_full_precision
def whitening_from_spread(positions: Array, prior_covariance: Array) -> Whitening:
    """Whiten by the sum of two inverse covariances: that of the members, and of a member given its context alone.

    Args:
        positions: Shape (M, d).
        prior_covariance: Shape (d, d).
    """
    count = positions.shape[0]
    centre = jnp.mean(positions, 0)
    prior = _shrink(prior_covariance, count)
    covariance = jnp.cov(positions.T, ddof=0).reshape(prior.shape)
    floor = 1e-6 * jnp.diagonal(prior)
    covariance = _shrink(covariance + jnp.diag(floor), count)
    return whitening(centre, jnp.linalg.inv(prior) + jnp.linalg.inv(covariance))


def _shrink(matrix: Array, count: int) -> Array:
    """A second moment (d, d) of few draws made positive definite: correlations shrink as if by d draws without any."""
    dimension = matrix.shape[0]
    diagonal = jnp.diagonal(matrix)
    largest = jnp.max(diagonal)
    floor = jnp.where(largest > 0, 1e-12 * largest, 1.0)
    share = count / (count + dimension)
    return share * matrix + (1.0 - share) * jnp.diag(diagonal) + jnp.diag(jnp.maximum(floor - diagonal, 0.0))
