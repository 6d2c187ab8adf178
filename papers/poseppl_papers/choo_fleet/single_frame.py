"""The jobs of section 7.3: estimates of one frame's posterior mean by computation spent, their reference, and their cost.

One long run yields the estimates at all settings of a row of Table 1: the first n particles of a particle filter, and the first
R updates of each chain, are a run of that size themselves. Estimates at different settings of one run are therefore dependent;
error bars hold for each by itself.

Methods and settings take turns, so that whatever slows the machine for a while slows all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.compilation import jit
from poseppl.filters import assumed_density_filter, hmc_filter, particle_filter
from poseppl.kernels import HMCSettings
from poseppl.program import CompiledModel, Observation
from poseppl_papers.choo_fleet.systems import (
    NUM_WARMUP,
    SYSTEMS,
    UPDATES,
    System,
    TrackerJob,
    frame_of,
    single_frames,
    stage_of,
)
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import stacked, timed

_COST = {"arm": 0.02, "lower_body": 0.35, "full_body": 1.0}
_SEED = 2001


@dataclass(frozen=True)
class FrameRuns(TrackerJob):
    """Runs of both filters and of the reference at one frame.

    Attributes:
        frame: Index of the frame.
        runs: Numbers of the runs; each has noise of its own.
        num_settings: How many settings of the row of Table 1.
        num_chains: Number of chains of the reference.
    """

    frame: int
    runs: tuple[int, ...]
    num_settings: int
    num_chains: int

    @property
    def name(self) -> str:
        """Tracker, recording, frame and the first run."""
        return f"frame-{self.system}-{self.recording.name}-{self.frame}-{self.runs[0]}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return len(self.runs) * _COST[self.system] * 2.0 ** (self.num_settings - 7)


def estimate_frame(job: FrameRuns) -> dict[str, Any]:
    """Compute the estimates.

    Returns:
        For each method ``METHOD_means`` (run, setting, d), ``METHOD_ess``, ``METHOD_num_likelihood`` and
        ``METHOD_num_gradient`` (run, setting), ``METHOD_rejection`` (run,); ``reference_mean`` and
        ``reference_standard_error`` (run, d), ``reference_covariance`` (run, d, d) and ``prior_sd`` (d,).
    """
    frame = frame_of(job.recording, job.system, job.frame)
    functions = compiled(job.recording, job.system, job.num_settings, job.num_chains)
    rows: list[dict[str, Any]] = []
    for run in job.runs:
        observation = frame.observe(run)
        row: dict[str, Any] = {}
        for number, (method, function) in enumerate(functions.items()):
            key = jax.random.fold_in(jax.random.key(_SEED), (run * 1000 + job.frame) * 4 + number)
            found = jax.device_get(function(key, observation, frame.inputs))
            row |= {f"{method}_{name}": values for name, values in found._asdict().items()}
        rows.append(row)
    arrays = stacked(rows)
    scale = np.asarray(frame.problem.record()["start_scale"])
    return arrays | {"prior_sd": scale[list(frame.stage.body.free_coordinates)]}


@lru_cache(maxsize=16)
def compiled(recording: Recording, system: str, num_settings: int, num_chains: int) -> dict[str, Estimate]:
    """The methods, ready to run at any frame."""
    model = frame_of(recording, system, 1).problem.model  # frames differ in their inputs alone
    functions = {method: estimates(model, SYSTEMS[system], num_settings) for method, estimates in ESTIMATES.items()}
    return {name: jit(function) for name, function in {**functions, "reference": reference(model, num_chains)}.items()}


_CACHE_FRIENDLY = 16_384
"""Particles that are evaluated at once; more of them leave the processor's caches."""
_REFERENCE = HMCSettings(num_updates=500, num_leapfrog=8, num_warmup=20, step_size=0.4, target_acceptance=0.85, jitter=0.5)


class Estimates(NamedTuple):
    """Estimates at S settings.

    Attributes:
        means: Estimated posterior means (S, d).
        ess: Effective number of particles (S,); that of all chains tells the spread of their means.
        rejection: Mean rejection rate; 0 for particles.
        num_likelihood: Evaluations of the likelihood (S,).
        num_gradient: Evaluations of its gradient (S,).
    """

    means: Array
    ess: Array
    rejection: Array
    num_likelihood: Array
    num_gradient: Array


class Reference(NamedTuple):
    """The posterior as a long run sees it.

    Attributes:
        mean: Shape (d,).
        standard_error: Standard error of the mean, from the spread of the chains' means, (d,).
        covariance: Shape (d, d).
    """

    mean: Array
    standard_error: Array
    covariance: Array


Estimate = Callable[[Array, Observation, Any], Estimates]
Estimator = Callable[[CompiledModel, System, int], Estimate]
"""From the model, the row of Table 1 and how many of its settings."""


class _Sum(NamedTuple):
    """A running importance-weighted sum: log of the total weight, and, per unit of it, the mean state and the square weight."""

    log_total: Array
    mean: Array
    log_square: Array


def particle_estimates(model: CompiledModel, system: System, num_settings: int) -> Estimate:
    """Weighted means of the first N, 2 N, 4 N, ... particles of a particle filter.

    Blocks of particles are independent runs of the filter's first frame, put together by their evidence.
    """
    size, per_setting = block_size(system.num_particles)
    block = particle_filter(model, size)
    counts = per_setting * 2 ** jnp.arange(num_settings)

    def estimate(rng_key: Array, observation: Observation, inputs: Any) -> Estimates:
        def add(total: _Sum, number: Array) -> tuple[_Sum, tuple[Array, Array]]:
            state, info = block.init(jax.random.fold_in(rng_key, number), observation, inputs)
            log_total = jnp.logaddexp(total.log_total, info.log_evidence)
            old, new = jnp.exp(total.log_total - log_total), jnp.exp(info.log_evidence - log_total)
            mean = old * total.mean + new * (jnp.exp(state.log_weights) @ state.particles)
            squares = 2 * info.log_evidence + jax.nn.logsumexp(2 * state.log_weights)
            log_square = jnp.logaddexp(total.log_square, squares)
            return _Sum(log_total, mean, log_square), (mean, jnp.exp(2 * log_total - log_square))

        nothing = jnp.asarray(-jnp.inf, float)
        start = _Sum(nothing, jnp.zeros(model.dimension, float), nothing)
        _, (means, ess) = jax.lax.scan(add, start, jnp.arange(per_setting * 2 ** (num_settings - 1)))
        none = jnp.zeros(num_settings)
        return Estimates(means[counts - 1], ess[counts - 1], none, counts * size, none)

    return estimate


def block_size(num_particles: int) -> tuple[int, int]:
    """Split a number of particles into equal blocks: their size, and how many."""
    number = -(-num_particles // _CACHE_FRIENDLY)
    while num_particles % number:
        number += 1
    return num_particles // number, number


def hmc_estimates(model: CompiledModel, system: System, num_settings: int) -> Estimate:
    """Means of the draws of the first R updates of each chain of the HMC filter, for each R of Table 1, less the warm-up."""
    updates = jnp.array(UPDATES[:num_settings])
    built = hmc_filter(model, system.num_chains, system.hmc(UPDATES[num_settings - 1]))

    def estimate(rng_key: Array, observation: Observation, inputs: Any) -> Estimates:
        state, info = built.init(rng_key, observation, inputs)
        kept = updates - NUM_WARMUP
        means = jnp.cumsum(jnp.mean(state.particles, 0), 0)[kept - 1] / kept[:, None]
        rejection = jnp.full(num_settings, 1 - info.acceptance)
        gradients = system.num_chains * (1 + updates * system.num_leapfrog)
        likelihoods = jnp.full(num_settings, system.num_chains)
        return Estimates(means, jnp.full(num_settings, info.ess), rejection, likelihoods, gradients)

    return estimate


ESTIMATES: Mapping[str, Callable[[CompiledModel, System, int], Estimate]] = {
    "particle": particle_estimates,
    "hmc": hmc_estimates,
}
"""By method."""


METHODS = tuple(ESTIMATES)


def reference(model: CompiledModel, num_chains: int) -> Callable[[Array, Observation, Any], Reference]:
    """A long run of many chains, which start in all modes and move in coordinates in which the posterior is round."""
    built = assumed_density_filter(model, num_chains, _REFERENCE, num_starts=100)

    def estimate(rng_key: Array, observation: Observation, inputs: Any) -> Reference:
        state, _ = built.init(rng_key, observation, inputs)
        draws = state.particles
        by_chain = jnp.mean(draws, 1)
        mean = jnp.mean(by_chain, 0)
        error = jnp.std(by_chain, 0, ddof=1) / num_chains**0.5
        offset = (draws - mean).reshape(-1, model.dimension)
        return Reference(mean, error, offset.T @ offset / len(offset))

    return estimate


@dataclass(frozen=True)
class FrameTiming(TrackerJob):
    """The times of all estimates of a tracker.

    Attributes:
        num_settings: How many settings of the row of Table 1.
        repeats: How often each is timed.
    """

    version: ClassVar[int] = 2
    num_settings: int
    repeats: int

    @property
    def name(self) -> str:
        """The tracker."""
        return f"timing-{self.system}"

    @property
    def cost(self) -> float:
        """Relative to a run of the full body at all settings."""
        return 4.0 * self.num_settings + self.repeats * 2.0 ** (self.num_settings - 6)


def time_frame(job: FrameTiming) -> dict[str, Any]:
    """Time the estimates, one after the other in each round.

    Returns:
        For each method ``METHOD_seconds`` (repeat, setting), without compilation.
    """
    frame = frame_of(job.recording, job.system, single_frames(stage_of(job.recording, job.system))[1])
    arguments = frame.observe(0), frame.inputs
    functions = {
        (method, setting): jit(estimate(frame.problem.model, job.row, setting + 1))
        for method, estimate in ESTIMATES.items()
        for setting in range(job.num_settings)
    }
    rounds = [
        {name: timed(function, jax.random.key(repeat), *arguments)[1] for name, function in functions.items()}
        for repeat in range(job.repeats + 1)
    ]
    return {
        f"{method}_seconds": np.array([[each[method, setting] for setting in range(job.num_settings)] for each in rounds[1:]])
        for method in ESTIMATES
    }  # the first round compiles
