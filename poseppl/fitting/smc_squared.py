r"""SMC^2: the posterior of the params frame by frame, by a swarm of params with a filter each.

Chopin, Jacob and Papaspiliopoulos 2013 (doi:10.1111/j.1467-9868.2012.01046.x). Each particle is a value of the params with a
filter of its own, whose evidence of a frame is the particle's weight. If the ESS falls below a share, params are resampled with
their filters, and moved by PMMH. Proposals come from N(u, \lambda^2 S), S the covariance of all params, and their filters run
through all frames so far. The method also estimates the evidence of the model, with the params integrated out.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least, check_fraction
from poseppl.compilation import jit
from poseppl.diagnostics.verdicts.verdict import ERROR, WARNING, Findings, Remedy, Verdict
from poseppl.filters.base import Filter
from poseppl.filters.scan import Frame, begin, collect_info, frame_keys, frame_program
from poseppl.fitting.problem import Estimate, Problem, likelihood_error
from poseppl.fitting.sampling import noisy_likelihood
from poseppl.kernels.adaptive_covariance import ridged
from poseppl.particles.resampling import systematic
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import nan_to_neg_inf, normalise, weighted_covariance
from poseppl.program.frame_inputs import split_inputs
from poseppl.smoothers.inner_filter import filter_for


class _Swarm(NamedTuple):
    """Params u (M, p), their log-weights (M,), the filters' states (M, ...) and log-evidences (M,)."""

    positions: Array
    log_weights: Array
    states: Any
    log_evidence: Array


class _Sequence:
    """Filters of many params, run frame by frame.

    Args:
        problem: The problem.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.layout, *inputs = split_inputs(problem.inputs)
        self.data, self.varying, self.constant = jax.tree.map(jnp.asarray, (problem.observations, *inputs))

    def filter(self, u: Array) -> Filter:
        """The filter of the params of u (p,)."""
        return filter_for(self.problem.bound(u), self.problem.build_filter)

    def frame(self, rng_key: Array, t: Any) -> Frame:
        """Frame t with its keys."""
        return Frame(frame_keys(rng_key, t), t, *tree_index((self.data, self.varying), t))

    def first(self, rng_key: Array, u: Array) -> tuple[Any, Array]:
        """State and log-evidence after frame 0."""
        frame, built = self.frame(rng_key, 0), self.filter(u)
        inputs = self.layout.join(frame.varying, self.constant)
        started = begin(built, frame.keys.step, frame.observation, inputs)
        if started.info is not None:
            return started.state, nan_to_neg_inf(started.info.log_evidence)
        state, info = built.step(frame.keys.step, started.state, frame.observation, inputs)
        return state, nan_to_neg_inf(info.log_evidence)

    def next(self, rng_key: Array, u: Array, state: Any, t: Any) -> tuple[Any, Array]:
        """State and log-evidence of frame t > 0."""
        advance = frame_program(self.filter(u), self.layout.join, collect_info, None)
        state, (info, _) = advance(state, None, self.frame(rng_key, t), self.constant)
        return state, nan_to_neg_inf(info.log_evidence)

    def until(self, rng_key: Array, u: Array, t: Any) -> tuple[Any, Array]:
        """State after frame t, and the log-evidence of all frames up to it."""

        def advance(number: Any, carry: tuple[Any, Array]) -> tuple[Any, Array]:
            state, increment = self.next(rng_key, u, carry[0], number)
            return state, carry[1] + increment

        reached: tuple[Any, Array] = jax.lax.fori_loop(1, t + 1, advance, self.first(rng_key, u))
        return reached


def smc2_method(
    problem: Problem,
    rng_key: Array,
    start: Mapping[str, Any] | None,
    *,
    num_params: int = 256,
    num_moves: int = 3,
    ess_threshold: float = 0.5,
) -> Estimate:
    """SMC^2: a swarm of params, each with a filter of its own, weighed frame by frame.

    Args:
        problem: The problem; its filter's evidence should be unbiased.
        rng_key: PRNG key.
        start: None: params start from the prior.
        num_params: M.
        num_moves: Moves of PMMH after each resampling.
        ess_threshold: Share of M below which the ESS leads to resampling.
    """
    check_at_least(2, num_params=num_params)
    check_at_least(1, num_moves=num_moves)
    check_fraction("(0, 1]", ess_threshold=ess_threshold)
    sequence = _Sequence(problem)
    key_start, key_frames, key_moves, key_last = jax.random.split(rng_key, 4)
    keys = jax.random.split(key_frames, num_params)
    positions = problem.prior_draws(key_start, num_params)
    states, evidence = jit(jax.vmap(sequence.first))(keys, positions)
    swarm = _Swarm(positions, jnp.full_like(evidence, -np.log(num_params)), states, jnp.zeros_like(evidence))
    swarm, increment, ess = jit(_weigh)(swarm, states, evidence)
    weigh = jit(
        lambda swarm, t: _weigh(swarm, *jax.vmap(sequence.next, (0, 0, 0, None))(keys, swarm.positions, swarm.states, t))
    )
    rejuvenate = jit(lambda key, swarm, t: _rejuvenate(sequence, key, swarm, t, num_moves))
    trace, rates = [float(increment)], []
    for t in range(1, problem.num_frames + 1):
        if ess < ess_threshold * num_params or t == problem.num_frames:
            swarm, rate = rejuvenate(jax.random.fold_in(key_moves, t), swarm, t - 1)
            rates.append(float(rate))
        problem.advance(1)
        if t < problem.num_frames:
            swarm, increment, ess = weigh(swarm, t)
            trace.append(float(increment))
    draws = np.asarray(swarm.positions, np.float64)[None]
    error = likelihood_error(problem, key_last, draws.mean((0, 1)))
    findings = (
        *_of_moves(trace, rates, len(np.unique(draws[0], axis=0)), num_params),
        *noisy_likelihood(error["log_likelihood_sd"]),
    )
    attrs = {"log_evidence": float(np.sum(trace)), "acceptance": rates, **error}
    statistics = {"log_likelihood": np.asarray(swarm.log_evidence)[None]}
    return Estimate(None, None, draws, statistics, trace, attrs, findings)


def _weigh(swarm: _Swarm, states: Any, increments: Array) -> tuple[_Swarm, Array, Array]:
    """The swarm after a frame, the log-evidence of the frame, and the ESS."""
    reweighed = normalise(swarm.log_weights + increments)
    evidence = reweighed.log_mean + jnp.log(len(increments))
    return _Swarm(swarm.positions, reweighed.log_weights, states, swarm.log_evidence + increments), evidence, reweighed.ess


def _rejuvenate(sequence: _Sequence, rng_key: Array, swarm: _Swarm, t: Any, num_moves: int) -> tuple[_Swarm, Array]:
    """Resample, and move by PMMH whose filters run up to frame t; the mean rate of acceptance is the second value."""
    number, size = swarm.positions.shape
    lower = jnp.linalg.cholesky(ridged(weighted_covariance(swarm.positions, swarm.log_weights)))
    key_resample, key_moves = jax.random.split(rng_key)
    ancestors = systematic(key_resample, swarm.log_weights, number)
    equal = jnp.full_like(swarm.log_weights, -jnp.log(number))
    swarm = tree_index(swarm, ancestors)._replace(log_weights=equal)
    problem = sequence.problem

    def log_prior(positions: Array) -> Array:
        return jax.vmap(lambda u: problem.bijector.log_prior(problem.model, u))(positions)

    def move(swarm: _Swarm, key: Array) -> tuple[_Swarm, Array]:
        key_step, key_filter, key_accept = jax.random.split(key, 3)
        noise = jax.random.normal(key_step, swarm.positions.shape, swarm.positions.dtype)
        proposed = swarm.positions + 2.38 / size**0.5 * noise @ lower.T
        states, evidence = jax.vmap(sequence.until, (0, 0, None))(jax.random.split(key_filter, number), proposed, t)
        log_ratio = evidence + log_prior(proposed) - swarm.log_evidence - log_prior(swarm.positions)
        uniform = jax.random.uniform(key_accept, log_ratio.shape, log_ratio.dtype)
        accepted = jnp.log(1.0 - uniform) < nan_to_neg_inf(log_ratio)
        new = _Swarm(proposed, equal, states, evidence)

        def chosen(new: Array, old: Array) -> Array:
            return jnp.where(accepted.reshape(-1, *[1] * (new.ndim - 1)), new, old)

        return jax.tree.map(chosen, new, swarm), jnp.mean(accepted)

    swarm, rates = jax.lax.scan(move, swarm, jax.random.split(key_moves, num_moves))
    return swarm, jnp.mean(rates)


def _of_moves(trace: list[float], rates: list[float], distinct: int, number: int) -> Findings:
    """Whether the swarm died, or hardly moves."""
    if not np.isfinite(trace).all():
        frame = int(np.flatnonzero(~np.isfinite(trace))[0])
        finding = f"The data of frame {frame} are impossible under all params: the draws mean nothing;"
        yield Verdict(ERROR, finding, (Remedy("raise {}, or change the model", "num_params"),))
    elif distinct < number / 4 or min(rates) < 0.02:
        finding = f"Params hardly move: {distinct} of {number} are distinct, and {min(rates):.0%} of the moves were accepted;"
        yield Verdict(WARNING, finding, (Remedy("give the filter more particles"), Remedy("raise {}", "num_moves")))
