"""One Markov chain of NUTS or hybrid Monte Carlo whose step size is adapted in a warm-up, with BlackJAX's kernels.

The step size follows the dual averaging of Hoffman and Gelman 2014 (algorithm 6, https://jmlr.org/papers/v15/hoffman14a.html)
towards a target acceptance rate, and is frozen before the draws that count. The mass matrix is the identity: the density is to
be given in coordinates where that fits (see :mod:`poseppl.kernels.laplace` and :mod:`poseppl.gaussians.block_tridiagonal`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import blackjax
import jax
import jax.numpy as jnp
from blackjax.adaptation.step_size import dual_averaging_adaptation
from jax import Array

from poseppl.checks import check_at_least, check_choice, check_fraction
from poseppl.compilation import with_full_precision
from poseppl.particles.weights import nan_to_neg_inf

Kernel = Literal["nuts", "hmc"]


class ChainSettings(NamedTuple):
    """Settings of a chain.

    Attributes:
        num_draws: Draws that count.
        num_warmup: Updates before them, in which the step size adapts; 0 keeps the step size that a chain starts with.
        kernel: "nuts" or "hmc".
        num_leapfrog: Leapfrog steps of an update of "hmc" at most; an update makes at random that many or down to half of them.
        max_doublings: "nuts" makes less than 2 to this power leapfrog steps an update.
        target_acceptance: Acceptance rate that the step size is adapted to.
    """

    num_draws: int
    num_warmup: int
    kernel: Kernel = "nuts"
    num_leapfrog: int = 16
    max_doublings: int = 8
    target_acceptance: float = 0.8

    def check(self) -> ChainSettings:
        """Return the settings, or raise ``ValueError`` that names the one that is out of range."""
        check_at_least(1, num_draws=self.num_draws, num_leapfrog=self.num_leapfrog, max_doublings=self.max_doublings)
        check_at_least(0, num_warmup=self.num_warmup)
        check_choice(Kernel, kernel=self.kernel)
        check_fraction("(0, 1)", target_acceptance=self.target_acceptance)
        return self


class AdaptedChain(NamedTuple):
    """Result of a chain.

    Attributes:
        draws: Positions after the warm-up (R, n).
        acceptance: Mean acceptance probability of the draws that count.
        divergences: How many updates after the warm-up diverged, int32.
        step_size: The frozen step size.
        num_gradient: Evaluations of the gradient, warm-up included, a float.
    """

    draws: Array
    acceptance: Array
    divergences: Array
    step_size: Array
    num_gradient: Array


@with_full_precision
def adapted_chain(
    rng_key: Array,
    start: Array,
    log_density: Callable[[Array], Array],
    settings: ChainSettings,
    num_steps: Array,
) -> AdaptedChain:
    """Run one chain; vmap it for several.

    Args:
        rng_key: PRNG key.
        start: Starting position (n,).
        log_density: Unnormalised log-density of a position (n,), a scalar; NaN counts as -inf.
        settings: How many draws of which kernel.
        num_steps: Leapfrog steps of each update (num_warmup + num_draws,), from `trajectory_lengths`; not read by "nuts".
            Chains that share them do not wait for each other.

    Returns:
        The draws after the warm-up and how it went.
    """

    def safe_density(position: Array) -> Array:
        return nan_to_neg_inf(log_density(position))

    move = _kernel(safe_density, start, settings)
    averaging, improve, _ = dual_averaging_adaptation(settings.target_acceptance)
    first = jnp.asarray(start.shape[0] ** -0.25, start.dtype)
    adaptation: Any = jax.tree.map(lambda leaf: jnp.asarray(leaf, start.dtype), averaging(first))
    if settings.num_warmup == 0:
        adaptation = adaptation._replace(log_step_size_avg=adaptation.log_step_size)

    # warm-up and draws in one loop: the kernel is compiled once
    def update(carry: tuple[Any, Any], row: tuple[Array, Array]) -> tuple[Any, Any]:
        state, adaptation = carry
        number, steps = row
        early = number < settings.num_warmup
        log_step_size = jnp.where(early, adaptation.log_step_size, adaptation.log_step_size_avg)
        state, info = move(jax.random.fold_in(rng_key, number), state, jnp.exp(log_step_size), steps)
        acceptance = jnp.where(jnp.isnan(info.acceptance_rate), 0.0, info.acceptance_rate).astype(start.dtype)
        improved = improve(adaptation, acceptance)
        adaptation = jax.tree.map(lambda new, old: jnp.where(early, new, old), improved, adaptation)
        return (state, adaptation), (state.position, acceptance, info.is_divergent, info.num_integration_steps)

    rows = jnp.arange(settings.num_warmup + settings.num_draws), num_steps
    state: Any = blackjax.hmc.init(start, safe_density)
    (_, adaptation), (draws, acceptance, divergent, steps) = jax.lax.scan(update, (state, adaptation), rows)
    kept = slice(settings.num_warmup, None)
    return AdaptedChain(
        draws=draws[kept],
        acceptance=jnp.mean(acceptance[kept]),
        divergences=jnp.sum(divergent[kept]).astype(jnp.int32),
        step_size=jnp.exp(adaptation.log_step_size_avg),
        num_gradient=(1 + jnp.sum(steps)).astype(start.dtype),
    )


def trajectory_lengths(rng_key: Array, settings: ChainSettings) -> Array:
    """Leapfrog steps of each update of "hmc" (num_warmup + num_draws,), int32."""
    shortest = (settings.num_leapfrog + 1) // 2
    return jax.random.randint(rng_key, (settings.num_warmup + settings.num_draws,), shortest, settings.num_leapfrog + 1)


def _kernel(density: Callable[[Array], Array], start: Array, settings: ChainSettings) -> Callable[..., Any]:
    """`(rng_key, state, step_size, num_steps) -> (state, info)`."""
    mass = jnp.ones_like(start)
    if settings.kernel == "hmc":
        hmc: Any = blackjax.hmc.build_kernel()
        return lambda key, state, step_size, steps: hmc(key, state, density, step_size, mass, steps)
    nuts: Any = blackjax.nuts.build_kernel()

    def move(key: Array, state: Any, step_size: Array, _: Array) -> Any:
        return nuts(unchecked(key), state, density, step_size, mass, settings.max_doublings)

    return move


def unchecked(rng_key: Array) -> Array:
    """The key as plain data: JAX's check of key reuse takes a vmapped loop, as NUTS is, for one that uses a key twice."""
    return jax.random.key_data(rng_key)
