r"""Particle marginal Metropolis-Hastings: static parameters by a random walk whose likelihood a filter estimates.

Andrieu, Doucet and Holenstein 2010, section 4.4 (doi:10.1111/j.1467-9868.2009.00736.x). In unconstrained coordinates u, propose
u' = u + lambda S^(1/2) N(0, 1) and accept with probability

    min(1, Z'(u') p(u') / (Z(u) p(u))),

where Z is the evidence of all frames as a filter estimates it. If exp(log Z) is unbiased, as for particle filters, the chain
targets exactly the posterior of u, whatever the number of particles. For this, Z(u) of the current point is kept and not
estimated again. Few particles make chains stick: the standard deviation of log Z should be about 1.

S is learned from all chains during the warm-up (:mod:`poseppl.kernels.adaptive_covariance`). In its first half lambda follows
the rate of acceptance, so that chains come from far starts to the posterior. A noisy log Z lowers that rate at any lambda,
which would shrink without end. In the second half lambda is therefore 2.38 / p^(1/2), near the best one at any noise
(Sherlock, Thiery, Roberts and Rosenthal 2015, doi:10.1214/14-AOS1278). Both are frozen before the draws that count.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least, check_key
from poseppl.errors import Argument, InputError
from poseppl.filters.base import Filter
from poseppl.kernels.adaptive_covariance import AdaptiveCovariance, initial_covariance, learn, ridged
from poseppl.particles.weights import nan_to_neg_inf
from poseppl.program import CompiledModel, Observation
from poseppl.program.frame_inputs import stacked_inputs
from poseppl.program.observation import num_frames_of
from poseppl.program.parameters import ParameterBijector, parameter_bijector
from poseppl.smoothers.inner_filter import filter_evidence, filter_for

Evaluate = Callable[[Array, Array], tuple[Array, Array]]

_TARGET_ACCEPTANCE = 0.25
_PRIOR_DRAWS = 64


class ParticleMarginal(NamedTuple):
    """Result of PMMH.

    Attributes:
        params: Draws by name (M, R, ...), constrained.
        unconstrained: The same draws (M, R, p).
        log_evidence: The filter's estimate at each draw (M, R).
        acceptance: Share of the proposals that were accepted, after the warm-up.
        scale: The frozen lambda.
        covariance: The frozen S (p, p).
    """

    params: dict[str, Array]
    unconstrained: Array
    log_evidence: Array
    acceptance: Array
    scale: Array
    covariance: Array


class _State(NamedTuple):
    """Positions (M, p), their log-posteriors and log-evidences (M,), log lambda, and what is known of the target."""

    positions: Array
    log_posterior: Array
    log_evidence: Array
    log_scale: Array
    known: AdaptiveCovariance


def pmmh(
    model: CompiledModel,
    rng_key: Array,
    observations: Observation,
    inputs: Any = None,
    *,
    build_filter: Callable[[CompiledModel], Filter],
    num_chains: int = 4,
    num_draws: int = 1000,
    num_warmup: int = 500,
    start: Mapping[str, Any] | None = None,
) -> ParticleMarginal:
    """Sample the posterior of a model's static parameters.

    Args:
        model: The compiled model, with a parameters program.
        rng_key: PRNG key.
        observations: Data with a leading T.
        inputs: Inputs with a leading T, constant parts wrapped in :class:`~poseppl.runs.run.Constant`; None where the model
            takes none.
        build_filter: `model -> filter`, say `lambda model: particle_filter(model, 500)`; its evidence should be unbiased.
        num_chains: M, chains side by side.
        num_draws: R, draws of each chain that count.
        num_warmup: Updates of each chain before them.
        start: Params by name that all chains start from; draws from the prior if None.

    Returns:
        The draws. The function can be jitted.

    Raises:
        ValueError: A number out of range, data that are not an Observation, or data or inputs that do not have T frames. Also a
            parameters program that cannot be learned, a start that is not a value of its params, or a `build_filter` that is
            not a function of the model.
    """
    check_at_least(1, num_chains=num_chains, num_draws=num_draws)
    check_at_least(0, num_warmup=num_warmup)
    check_key(rng_key)
    inputs = stacked_inputs(inputs, num_frames_of(model.observation_sites, observations))
    bijector = parameter_bijector(model)

    def evaluate(rng_key: Array, u: Array) -> tuple[Array, Array]:
        """Log-posterior and log-evidence at u."""
        built = filter_for(model.with_params(bijector.to_params(u)), build_filter)
        log_evidence = filter_evidence(built, rng_key, observations, inputs)
        log_posterior = log_evidence + bijector.log_prior(model, u)
        return nan_to_neg_inf(log_posterior), log_evidence

    key_start, key_first, key_updates = jax.random.split(rng_key, 3)
    positions, known = starting_points(model, bijector, key_start, num_chains, start)
    log_posterior, log_evidence = jax.vmap(evaluate)(jax.random.split(key_first, num_chains), positions)
    first = _State(positions, log_posterior, log_evidence, _best_log_scale(positions), known)
    rows = jax.random.split(key_updates, num_warmup + num_draws), jnp.arange(num_warmup + num_draws)
    final, (draws, evidences, accepted) = jax.lax.scan(partial(_update, evaluate, num_warmup), first, rows)
    unconstrained = jnp.swapaxes(draws[num_warmup:], 0, 1)
    return ParticleMarginal(
        params=jax.vmap(jax.vmap(bijector.to_params))(unconstrained),
        unconstrained=unconstrained,
        log_evidence=evidences[num_warmup:].T,
        acceptance=jnp.mean(accepted[num_warmup:]),
        scale=jnp.exp(final.log_scale),
        covariance=final.known.covariance,
    )


def starting_points(
    model: CompiledModel, bijector: ParameterBijector, rng_key: Array, num_chains: int, start: Mapping[str, Any] | None
) -> tuple[Array, AdaptiveCovariance]:
    """The starts of the chains (M, p), and the prior's moments as first estimates."""
    keys = jax.random.split(rng_key, max(_PRIOR_DRAWS, num_chains))
    drawn = jax.vmap(lambda key: bijector.to_flat(model.sample_parameters(key)))(keys)
    known = initial_covariance(drawn)
    if start is None:
        return drawn[:num_chains], known
    return jnp.broadcast_to(flat_start(bijector, start), (num_chains, bijector.dimension)), known


def flat_start(bijector: ParameterBijector, start: Mapping[str, Any]) -> Array:
    """The flat vector (p,) of a start, whose values are checked where they are known."""
    if set(start) != set(bijector.sites):
        expected = f"those of the parameters program, {sorted(bijector.sites)}"
        raise InputError(f"the names {sorted(start)}", field=Argument("start"), expected=expected)
    for name, site in bijector.sites.items():
        if np.shape(start[name]) != site.shape:
            raise InputError(f"{name} has shape {np.shape(start[name])}", field=Argument("start"), expected=f"{site.shape}")
    flat = bijector.to_flat(start)
    if not isinstance(flat, jax.core.Tracer):
        for name, site in bijector.sites.items():
            if not np.isfinite(site.unflatten(flat)).all():
                raise InputError(f"{name} is {start[name]}", field=Argument("start"), expected="a value inside of its support")
    return flat


def _update(evaluate: Evaluate, num_warmup: int, state: _State, row: tuple[Array, Array]) -> tuple[_State, Any]:
    """One move of all chains."""
    key, number = row
    key_move, key_filter, key_accept = jax.random.split(key, 3)
    lower = jnp.linalg.cholesky(ridged(state.known.covariance))
    noise = jax.random.normal(key_move, state.positions.shape, state.positions.dtype)
    proposed = state.positions + jnp.exp(state.log_scale) * noise @ lower.T
    values, evidence = jax.vmap(evaluate)(jax.random.split(key_filter, proposed.shape[0]), proposed)
    log_ratio = jnp.where(jnp.isneginf(values), -jnp.inf, values - state.log_posterior)
    accepted = jnp.log(1.0 - jax.random.uniform(key_accept, values.shape, values.dtype)) < log_ratio
    moved = state._replace(
        positions=jnp.where(accepted[:, None], proposed, state.positions),
        log_posterior=jnp.where(accepted, values, state.log_posterior),
        log_evidence=jnp.where(accepted, evidence, state.log_evidence),
    )
    moved = _adapt(moved, jnp.mean(jnp.exp(jnp.minimum(log_ratio, 0.0))), number, num_warmup)
    return moved, (moved.positions, moved.log_evidence, jnp.mean(accepted, dtype=values.dtype))


def _best_log_scale(positions: Array) -> Array:
    """Log lambda at which a random walk in p coordinates mixes best if S is the posterior's covariance."""
    return jnp.asarray(np.log(2.38 / positions.shape[-1] ** 0.5), positions.dtype)


def _adapt(state: _State, rate: Array, number: Array, num_warmup: int) -> _State:
    """Learn from an update of the warm-up; later ones change nothing."""
    settled = num_warmup // 2
    coming = number < settled
    step = ((number + 1.0) ** -0.6 * (rate - _TARGET_ACCEPTANCE)).astype(state.log_scale.dtype)
    learned = state._replace(
        log_scale=jnp.where(coming, state.log_scale + step, _best_log_scale(state.positions)),
        known=learn(state.known, state.positions, jnp.where(coming, number, number - settled), jnp.where(coming, 0.6, 1.0)),
    )
    adapted: _State = jax.tree.map(lambda new, old: jnp.where(number < num_warmup, new, old), learned, state)
    return adapted
