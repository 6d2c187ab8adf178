r"""Tempered sequential Monte Carlo: from draws of a prior p(x | c) to its posterior, along p(x | c) L(x)^beta.

Algorithm 2 of Chopin 2002 (doi:10.1093/biomet/89.3.539) and section 3.4 of Del Moral, Doucet and Jasra 2006
(doi:10.1111/j.1467-9868.2006.00553.x), with contexts that are resampled together with the positions. From
beta = 0 until beta = 1:

1. reweight: beta rises by the delta at which the incremental weights L(x_i)^delta have ESS = target * N, found by bisection on
   the present particles, moved at the last beta, so that the target is met exactly;
2. the evidence is multiplied by the mean incremental weight;
3. resample positions and contexts together;
4. move each position at the new beta: the particles that are returned, too, were moved, at beta = 1.

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
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.kernels.laplace import Whitening
from poseppl.kernels.moves import (
    ConditionalDensity,
    MoveSettings,
    Starts,
    evaluate,
    move_groups,
    whitening_from_gradients,
    whitening_from_spread,
)
from poseppl.particles.resampling import Resampling
from poseppl.particles.weights import effective_sample_size, normalise, without_infinity

_BISECTIONS = 40


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
    goal = ess_target * jnp.sum(jnp.isfinite(log_likelihoods))

    def halve(_: int, bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        middle = 0.5 * (low + high)
        enough = effective_sample_size(middle * log_likelihoods) >= goal
        return jnp.where(enough, middle, low), jnp.where(enough, high, middle)

    low, high = jax.lax.fori_loop(0, _BISECTIONS, halve, (jnp.zeros_like(limit), limit))
    # never nothing: a delta of zero would neither end the loop nor silence a likelihood of zero
    found = jnp.where(low > 0, low, high)
    return jnp.where(effective_sample_size(limit * log_likelihoods) >= goal, limit, found)


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

    def unfinished(carry: tuple[Array, Tempered]) -> Array:
        run = carry[1]
        cooled = (run.num_temperatures > 0) & (run.temperatures[run.num_temperatures - 1] == 1.0)
        return ~run.failed & ~cooled & (run.num_temperatures < cap)

    def cool(carry: tuple[Array, Tempered]) -> tuple[Array, Tempered]:
        rng_key, run = carry
        rng_key, key_resample, key_move = jax.random.split(rng_key, 3)
        number = run.num_temperatures
        values = jax.vmap(likelihood)(run.particles)
        delta, beta = _next_temperature(run, values, settings)
        weighted = normalise(delta * values)
        chosen = settings.resampling(key_resample, weighted.log_weights, num_starts)
        ancestors = run.ancestors[chosen]

        def log_density(x: Array, context: Any) -> Array:
            return log_prior(x, context) + beta * likelihood(x)

        context = jax.tree.map(lambda leaf: leaf[ancestors], contexts)
        starts = evaluate(run.particles[chosen], context, log_density, moves)
        moved = move_groups(key_move, starts, log_density, whitening_of, run.log_step_size, moves)
        kept = moved.positions[-1:]
        if settings.chain_length > 1:
            kept = jnp.concatenate([starts.positions[None], moved.positions])
        after = run._replace(
            particles=kept.reshape(particles.shape),
            ancestors=jnp.tile(ancestors, settings.chain_length),
            log_evidence=run.log_evidence + weighted.log_mean,
            temperatures=run.temperatures.at[number].set(beta),
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
        return rng_key, jax.tree.map(lambda a, b: jnp.where(weighted.degenerate, a, b), failed, after)

    start = _untempered(particles, log_step_size, cap)
    return jax.lax.while_loop(unfinished, cool, (rng_key, start))[1]


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
