r"""Tempered sequential Monte Carlo: from draws of a prior p(x | c) to its posterior, along p(x | c) L(x)^beta.

Algorithm 2 of Chopin 2002 (doi:10.1093/biomet/89.3.539) and section 3.4 of Del Moral, Doucet and Jasra 2006
(doi:10.1111/j.1467-9868.2006.00553.x), with contexts that are resampled together with the positions. From
beta = 0 until beta = 1:

1. reweight: beta rises by the delta at which the incremental weights L(x_i)^delta have ESS = target * N. Bisection on the
   present particles, already moved at the last beta, finds it, so the target is met exactly;
2. the evidence is multiplied by the mean incremental weight;
3. resample positions and contexts together;
4. move each position at the new beta; the particles that are returned were also moved, at beta = 1.

Steps 3 and 4 are BlackJAX's SMC step, to which moves whitened by others are handed as its update, and step 1 is its ESS solver.
Its adaptive tempered SMC as a whole is not used: it moves particles at the previous temperature, never at 1, and chooses the
temperature before it moves them (``pytest tests/kernels/test_blackjax_limits.py``). In 28 dimensions its ESS per gradient is
0.4 times as large (``python -m benchmarks.frame_samplers``).

Waste-free form (Dau and Chopin 2022, doi:10.1111/rssb.12475): only M = N / P particles are resampled, each makes a chain of
P - 1 moves, and all N states of the chains are kept.

With temperatures and moves fixed beforehand, the mean of exp(log_evidence) is the evidence. Temperatures, whitening and step
size that are learned from the particles leave a bias that vanishes with N (Beskos, Jasra, Kantas and Thiery 2016,
doi:10.1214/15-AAP1113); particles are whitened by others (:func:`poseppl.kernels.moves.move_groups`), which leaves little.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from blackjax.smc.base import SMCState, step as smc_step
from blackjax.smc.ess import ess_solver
from blackjax.smc.solver import dichotomy
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.kernels.laplace import Whitening
from poseppl.kernels.moves import (
    ConditionalDensity,
    Moved,
    MoveSettings,
    Starts,
    evaluate,
    move_groups,
    whitening_from_gradients,
    whitening_from_spread,
)
from poseppl.particles.resampling import Resampling
from poseppl.particles.weights import Normalised, normalise, without_infinity

_LEAST = 2.0**-40
"""Least share of what is left that a temperature rises by."""


class Tempering(NamedTuple):
    """Settings of a run.

    Attributes:
        ess_target: Fraction of N that the ESS falls to at each temperature but the last.
        max_temperatures: How many there are at most; the last takes all that is left.
        temperatures: Fixed ones, ascending to 1, instead of adaptive ones.
        chain_length: P of the waste-free form; 1 moves all N particles.
        whiten: Whether moves are whitened by the particles; if not, they are in the state's own units.
        moves: Settings of the moves; in the waste-free form P - 1 stands for their number.
        resampling: A scheme.
    """

    ess_target: float
    max_temperatures: int
    temperatures: tuple[float, ...] | None
    chain_length: int
    whiten: bool
    moves: MoveSettings
    resampling: Resampling


class Tempered(NamedTuple):
    """Result of a tempering run.

    Attributes:
        particles: Equally weighted draws of the posterior (N, d), or of the prior where failed.
        ancestors: For each the particle of the prior that it comes from (N,), int32.
        log_evidence: Log of the mean likelihood under the prior; -inf where failed.
        failed: Whether no particle of the prior had positive likelihood.
        temperatures: Those gone through, filled up with ones (max_temperatures,).
        ess: The ESS had at each, before resampling, filled up with N (max_temperatures,).
        num_temperatures: How many, int32.
        acceptance: Mean acceptance rate of the moves, 1 without any.
        divergences: Updates that diverged, int32.
        log_step_size: The adapted log step size.
        num_likelihood: Evaluations of the likelihood, int32.
        num_gradient: Evaluations of its gradient, int32.
    """

    particles: Array
    ancestors: Array
    log_evidence: Array
    failed: Array
    temperatures: Array
    ess: Array
    num_temperatures: Array
    acceptance: Array
    divergences: Array
    log_step_size: Array
    num_likelihood: Array
    num_gradient: Array


def next_increment(log_likelihoods: Array, ess_target: float, limit: Array) -> Array:
    """The largest delta up to `limit` at which the weights exp(delta * log_likelihoods) have the ESS asked for.

    Args:
        log_likelihoods: Shape (N,), none NaN or +inf.
        ess_target: As a fraction of the particles of positive likelihood.
        limit: The remaining distance to a temperature of one, a scalar.
    """
    share = ess_target * jnp.mean(jnp.isfinite(log_likelihoods), dtype=limit.dtype)
    found = ess_solver(lambda values: values, log_likelihoods, share, limit, dichotomy)
    # never nothing: a delta of zero would neither end the loop nor silence a likelihood of zero
    return jnp.fmax(found, _LEAST * limit)


@with_full_precision
def temper(
    rng_key: Array,
    particles: Array,
    contexts: Any,
    log_prior: ConditionalDensity,
    log_likelihood: Callable[[Array], Array],
    prior_covariance: Array,
    log_step_size: Array,
    settings: Tempering,
) -> Tempered:
    """Temper draws of a prior into draws of its posterior.

    Args:
        rng_key: PRNG key.
        particles: Equally weighted draws (N, d).
        contexts: The arguments of each prior, a pytree with a leading axis of N; resampled with the particles.
        log_prior: Log-density of a position given its context.
        log_likelihood: Log-density of a position; NaN and +inf count as -inf.
        prior_covariance: Covariance of a position given its context (d, d), for random walks alone.
        log_step_size: Log step size to start from.
        settings: How.
    """
    count = particles.shape[0]
    cap = settings.max_temperatures if settings.temperatures is None else len(settings.temperatures)
    num_starts, moves = count // settings.chain_length, settings.moves
    if settings.chain_length > 1:
        moves = moves._replace(num_moves=settings.chain_length - 1)

    whitening_of = partial(_whitening, prior_covariance=prior_covariance, settings=settings)

    def likelihood(x: Array) -> Array:
        return without_infinity(log_likelihood(x))

    def move(rng_keys: Array, descended: _Descended, cooling: _Cooling) -> tuple[_Descended, Moved]:
        """Move particles that were resampled; BlackJAX's update of an SMC step."""

        def log_density(x: Array, context: Any) -> Array:
            return log_prior(x, context) + cooling.temperature * likelihood(x)

        context = jax.tree.map(lambda leaf: leaf[descended.ancestors], contexts)
        starts = evaluate(descended.positions, context, log_density, moves)
        moved = move_groups(rng_keys, starts, log_density, whitening_of, cooling.log_step_size, moves)
        kept = moved.positions[-1:]
        if settings.chain_length > 1:
            kept = jnp.concatenate([starts.positions[None], moved.positions])
        ancestors = jnp.tile(descended.ancestors, settings.chain_length)
        return _Descended(kept.reshape(particles.shape), ancestors), moved

    def unfinished(carry: tuple[Array, Tempered]) -> Array:
        run = carry[1]
        cooled = (run.num_temperatures > 0) & (run.temperatures[run.num_temperatures - 1] == 1.0)
        return ~run.failed & ~cooled & (run.num_temperatures < cap)

    def cool(carry: tuple[Array, Tempered]) -> tuple[Array, Tempered]:
        rng_key, run = carry
        rng_key, key_step = jax.random.split(rng_key)
        values = jax.vmap(likelihood)(run.particles)
        delta, beta = _next_temperature(run, values, settings)
        weighted = normalise(delta * values)
        weighed = SMCState(_Descended(run.particles, run.ancestors), weighted.log_weights, _Cooling(beta, run.log_step_size))
        after, info = smc_step(key_step, weighed, move, _alike, settings.resampling, num_starts)
        return rng_key, _cooled(run, after.particles, info.update_info, weighted, beta)

    start = _untempered(particles, log_step_size, cap)
    return jax.lax.while_loop(unfinished, cool, (rng_key, start))[1]


class _Descended(NamedTuple):
    """Particles as BlackJAX's step resamples them: positions (N, d), and the particles of the prior that they come from."""

    positions: Array
    ancestors: Array


class _Cooling(NamedTuple):
    """Inputs of the moves at one temperature."""

    temperature: Array
    log_step_size: Array


def _alike(descended: _Descended) -> Array:
    """Log-weights (N,) of particles that were resampled and moved."""
    return jnp.zeros(descended.ancestors.shape, descended.positions.dtype)


def _cooled(run: Tempered, descended: _Descended, moved: Moved, weighted: Normalised, temperature: Array) -> Tempered:
    """The run after a temperature; failed and without moves if no particle had a weight."""
    number, count = run.num_temperatures, len(run.particles)
    after = run._replace(
        particles=descended.positions,
        ancestors=descended.ancestors,
        log_evidence=run.log_evidence + weighted.log_mean,
        temperatures=run.temperatures.at[number].set(temperature),
        ess=run.ess.at[number].set(weighted.ess),
        num_temperatures=number + 1,
        acceptance=run.acceptance + (moved.acceptance - run.acceptance) / (number + 1),
        divergences=run.divergences + moved.divergences,
        log_step_size=moved.log_step_size,
        num_likelihood=run.num_likelihood + moved.num_density + count,
        num_gradient=run.num_gradient + moved.num_gradient,
    )
    failed = run._replace(
        log_evidence=jnp.full_like(run.log_evidence, -jnp.inf),
        failed=jnp.bool_(True),
        num_likelihood=run.num_likelihood + count,
    )
    chosen: Tempered = jax.tree.map(lambda a, b: jnp.where(weighted.degenerate, a, b), failed, after)
    return chosen


def _next_temperature(run: Tempered, log_likelihoods: Array, settings: Tempering) -> tuple[Array, Array]:
    """By how much the temperature rises, and to what; the last one takes all that is left."""
    number, cap = run.num_temperatures, len(run.temperatures)
    previous = jnp.where(number == 0, 0.0, run.temperatures[number - 1])
    left = 1.0 - previous
    if settings.temperatures is None:
        delta = next_increment(log_likelihoods, settings.ess_target, left)
    else:
        delta = jnp.asarray(settings.temperatures, log_likelihoods.dtype)[number] - previous
    delta = jnp.where(number == cap - 1, left, delta)
    return delta, jnp.where(delta == left, 1.0, previous + delta)


def _untempered(particles: Array, log_step_size: Array, max_temperatures: int) -> Tempered:
    count, dtype = particles.shape[0], particles.dtype
    return Tempered(
        particles=particles,
        ancestors=jnp.arange(count, dtype=jnp.int32),
        log_evidence=jnp.zeros((), dtype),
        failed=jnp.bool_(False),
        temperatures=jnp.ones(max_temperatures, dtype),
        ess=jnp.full(max_temperatures, count, dtype),
        num_temperatures=jnp.int32(0),
        acceptance=jnp.ones((), dtype),
        divergences=jnp.int32(0),
        log_step_size=jnp.asarray(log_step_size, dtype),
        num_likelihood=jnp.int32(0),
        num_gradient=jnp.int32(0),
    )


def _whitening(starts: Starts, prior_covariance: Array, settings: Tempering) -> Whitening:
    if not settings.whiten:
        origin = jnp.zeros_like(starts.positions[0])
        return Whitening(origin, origin + 1.0)
    if settings.moves.kernel == "random-walk":
        return whitening_from_spread(starts.positions, prior_covariance)
    return whitening_from_gradients(starts)
