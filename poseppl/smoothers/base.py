"""The interface of every smoother: one pure function from a filter's history to the smoothed states; and draws as a result.

    smooth(rng_key, history, observations, inputs) -> smoothed

`observations` and `inputs` have a leading axis of T frames. Inputs follow the time convention of `poseppl.program`: row t is
known at frame t, so the transition into frame t takes row t. The driver, :func:`poseppl.runs.smoothing.run_smoother`, masks the
data of the frames that the filter reported as failed; a smoother sees them as frames without data.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

import blackjax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.filters.base import FilterInfo, check_noise
from poseppl.gaussians.gaussian import RootGaussian
from poseppl.gaussians.marginals import Marginals
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation


class History(NamedTuple):
    """Output of a filter that a smoother needs, with a leading axis of T frames.

    Attributes:
        particles: Flat states (T, N, d); the draws of all chains for a filter of chains.
        log_weights: Normalised log-weights (T, N).
        ancestors: The filter's ancestors (T, A), int32; A is N for particle filters, whose genealogy they are.
        failed: Whether a frame's data were impossible (T,).
    """

    particles: Array
    log_weights: Array
    ancestors: Array
    failed: Array


class SmoothingInfo(NamedTuple):
    """Diagnosis of a smoothing; every smoother fills every field.

    Attributes:
        ess: Effective number of particles or draws at each frame (T,).
        acceptance: Mean acceptance rate of the moves at each frame (T,), in [0, 1]; 1 when there are none.
        divergences: Number of divergent trajectories, int32.
        num_transition: Evaluations of the transition density, a float (they may be many).
        num_gradient: Evaluations of the gradient of a frame's density, a float.
        unreachable: Share of each frame's smoothed weight or trajectories (T,) that no state of the next frame can come from,
            in [0, 1]: they are then the filter's, and not smoothed.
    """

    ess: Array
    acceptance: Array
    divergences: Array
    num_transition: Array
    num_gradient: Array
    unreachable: Array


class Approximation(NamedTuple):
    """How near a distribution q that was fitted to the posterior of a trajectory is to it.

    Attributes:
        bound: Estimates of E_q[log p(x, z) - log q(x)], at most the log-evidence, at each step of the fit (K,).
        log_ratios: log p(x, z) - log q(x) of the draws (N,); their mean is the bound that was reached.
    """

    bound: Array
    log_ratios: Array


class Smoothed(NamedTuple):
    """The smoothing distributions of T frames, in the form of a filter's states.

    Attributes:
        particles: Flat states (T, N, d), or (T, M, R, d) for M Markov chains of R draws.
        log_weights: Normalised log-weights (T, N), or zeros (T, M, R).
        info: Diagnosis.
        marginals: Moments of every frame, with a leading T, where the smoother knows them without draws.
        approximation: The fit, where the draws are of a distribution that was fitted.
    """

    particles: Array
    log_weights: Array
    info: SmoothingInfo
    marginals: Marginals | None = None
    approximation: Approximation | None = None


class GaussianPasses(NamedTuple):
    """The smoothed Gaussians of T frames, and how trajectories are drawn from the last frame back.

    Given the state x_(t+1) of the next frame, that of frame t is N(means_t + gains_(t+1) (x_(t+1) - predicted_(t+1)),
    roots_t roots_t^T); that of the last frame is N(means_T, roots_T roots_T^T).

    Attributes:
        smoothed: Means (T, d), and roots (T, d, d) of the covariances.
        means: Means of the filter (T, d).
        predicted: Means of the predictions (T, d).
        gains: Matrices (T, d, d), 0 at the first frame.
        roots: Roots of the covariances (T, d, d).
        info: Diagnosis.
    """

    smoothed: RootGaussian
    means: Array
    predicted: Array
    gains: Array
    roots: Array
    info: SmoothingInfo


@dataclasses.dataclass(frozen=True, eq=False)
class Smoother:
    """A smoothing algorithm for one model; what was compiled for it is kept with it.

    Attributes:
        smooth: `(rng_key, history, observations, inputs) -> smoothed`.
        joint: Whether the particles of one index are a draw of a whole trajectory; else only each frame's marginal is known.
        requires_genealogy: Whether it needs all of the filter's particles and their ancestors, not only draws.
        closed_form: Whether its means come from a formula, without Monte Carlo error, whatever is drawn from them.
        reweighs: Whether it draws nothing and gives the filter's particles new weights, which are exact where these are all
            values of the state.
        is_optimizer: Whether it returns only the most probable trajectory, whose standard deviations mean nothing.
        reads_particles: Whether it starts from the filter's states, rather than from the data alone.
        passes: `(history, observations, inputs) -> passes` of a smoother of Gaussians, whose draws need no compiled program.
        num_draws: How many trajectories such a smoother draws.
        model: The model; None for a smoother whose builder is not decorated with
            :func:`~poseppl.program.memoized_builder.memoized_builder`, which sets it.
    """

    smooth: Callable[[Array, History, Observation, Any], Smoothed]
    joint: bool
    requires_genealogy: bool = False
    closed_form: bool = False
    reweighs: bool = False
    is_optimizer: bool = False
    reads_particles: bool = True
    passes: Callable[[History, Observation, Any], GaussianPasses] | None = None
    num_draws: int = 0
    model: CompiledModel | None = dataclasses.field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "smooth", with_full_precision(self.smooth))

    @property
    def provenance(self) -> dict[str, Any]:
        """Attributes of a result that describe the smoother, for diagnostics."""
        fields = {"closed form": self.closed_form, "joint": self.joint}
        return fields | ({"optimizer": True} if self.is_optimizer else {})


NOISELESS = "backward_simulation_smoother or particle_gibbs_smoother, or for linear models rauch_tung_striebel_smoother"
"""Smoothers of models with sites that have no noise."""


def collect_history(rng_key: Array, state: Any, info: FilterInfo, inputs: Any) -> History:
    """Collector for :func:`poseppl.runs.run.run_filter`: all particles with their weights and ancestors."""
    particles = state.particles.reshape(-1, state.particles.shape[-1])
    return History(particles, normalise(state.log_weights.reshape(-1)).log_weights, info.ancestors, info.failed)


def check_continuous(model: CompiledModel) -> None:
    """Refuse models whose trajectories have no density with a gradient.

    Raises:
        ValueError: A site takes integers, or has no noise.
    """
    discrete = [name for name, site in model.sites.items() if site.discrete]
    if discrete:
        raise ValueError(f"Site {discrete[0]!r} is discrete, and has no gradient: use particle_gibbs_smoother.")
    check_noise(model, NOISELESS)


def smoothing_info(
    num_frames: int,
    ess: Array,
    *,
    acceptance: Any = 1.0,
    divergences: Any = 0,
    num_transition: Any = 0.0,
    num_gradient: Any = 0.0,
    unreachable: Any = 0.0,
) -> SmoothingInfo:
    """Fill in a diagnosis; scalars `ess`, `acceptance` and `unreachable` count for all T frames."""
    dtype = jnp.result_type(float)
    return SmoothingInfo(
        ess=jnp.broadcast_to(jnp.asarray(ess, dtype), (num_frames,)),
        acceptance=jnp.broadcast_to(jnp.asarray(acceptance, dtype), (num_frames,)),
        divergences=jnp.asarray(divergences, jnp.int32),
        num_transition=jnp.asarray(num_transition, dtype),
        num_gradient=jnp.asarray(num_gradient, dtype),
        unreachable=jnp.broadcast_to(jnp.asarray(unreachable, dtype), (num_frames,)),
    )


def smoothed_chains(draws: Array, **diagnosis: Any) -> Smoothed:
    """The result of chains (T, M, R, d), whose draws weigh the same; what else there is to say goes to `smoothing_info`."""
    info = smoothing_info(len(draws), effective_draws_by_frame(draws), **diagnosis)
    return Smoothed(draws, jnp.zeros(draws.shape[:-1], draws.dtype), info)


def smoothed_draws(draws: Array, marginals: Marginals | None = None, **diagnosis: Any) -> Smoothed:
    """The result of independent trajectories (T, N, d) of one weight; what else there is to say goes to `smoothing_info`."""
    num_frames, num_draws = draws.shape[:2]
    log_weights = jnp.full((num_frames, num_draws), -jnp.log(num_draws), draws.dtype)
    return Smoothed(draws, log_weights, smoothing_info(num_frames, jnp.asarray(num_draws), **diagnosis), marginals)


def effective_draws_by_frame(particles: Array) -> Array:
    """Effective number of draws (T,) of chains (T, M, R, d): that of the worst coordinate's mean, from 1 to M R."""
    num_frames, num_chains, num_draws, dimension = particles.shape
    if num_draws < 4:
        return jnp.full(num_frames, float(num_chains), particles.dtype)
    chains = jnp.moveaxis(particles, 0, 2).reshape(num_chains, num_draws, -1)
    ess = blackjax.diagnostics.effective_sample_size(chains).reshape(num_frames, dimension)
    worst = jnp.min(jnp.where(jnp.isnan(ess), 1.0, ess), 1)
    return jnp.clip(worst, 1.0, num_chains * num_draws)
