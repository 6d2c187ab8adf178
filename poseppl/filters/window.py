r"""The moving-window HMC filter: chains on the joint density of the last W frames, the older past summarised.

With s the window's first frame, the target of frame t = s + W - 1 is (see :mod:`poseppl.filters.window_target`)

    N(x_s; m_s, P_s) p(z_s | x_s) prod over u = s + 1 .. t of p(x_u | x_(u-1)) p(z_u | x_u),    N(m_s, P_s) for p(x_s | z_(<s)).

The summary must have seen no data of the window, or they would count twice. The window's own draws of x_(s-1) at frame t - 1
have: pushed through the transition, they represent x_s given z_0 .. z_(t-1). So the summary is made when the data up to
frame s - 1 alone are in: it is the prediction, by its first two moments, from the filtered draws of x_(s-1) at frame s - 1,

    m_s = mean of E[x_s | x],    P_s = cov of E[x_s | x] + mean of Cov[x_s | x],    x over those draws,

and waits in a queue of W predictions until its frame is the window's oldest. The first term of P_s is multiplied by the bias of
its inverse (see :func:`covariance_inflation`). A draw of frame t has then been through one Gaussian summary in
every W frames, where W = 1 takes one in each; for linear Gaussian models any W is exact up to the Monte Carlo error of m and P.

Chains start in modes of the joint density. Draws from the prediction climb to the modes of the newest frame, as with W = 1;
each gets a past, drawn from the last window's trajectories by the density of the transition to it (a step of backward
simulation), and the whole climbs on. A mode that several reach has its mass once.

The draws of the window's older frames are smoothed: those of x_s are a fixed-lag smoother's, with a lag of W - 1 frames.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.assumed_density import TRACKER
from poseppl.filters.base import Filter, FilterInfo, check_noise, filter_info, filter_of_steps
from poseppl.filters.chains import effective_draws, mask_failed
from poseppl.filters.mode_chains import CANDIDATES, chains_from_modes
from poseppl.filters.window_target import Window, empty_window, move_on, window_target
from poseppl.gaussians.gaussian import Gaussian, precision_of
from poseppl.gaussians.mixture import GaussianMixture, draw_mixture, log_mixture
from poseppl.kernels.hmc import Chains, HMCSettings
from poseppl.kernels.laplace import GAUSS_NEWTON_TRIALS, find_modes, mode_log_weights
from poseppl.particles.resampling import systematic
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_likelihoods, log_transition_matrix, transition_moments


class WindowState(NamedTuple):
    """State of the window filter: what the next frame needs.

    Attributes:
        particles: Draws of the newest frame after the warm-up (M, R - b, d).
        log_weights: Zeros (M, R - b): all draws count alike.
        log_step_size: The adapted log step size.
        trajectories: Draws of the whole window (M, R - b, W, d), the newest frame last; slots without a frame yet are noise.
        window: Summaries, data and inputs of its frames.
    """

    particles: Array
    log_weights: Array
    log_step_size: Array
    trajectories: Array
    window: Window


@memoized_builder
def window_filter(
    model: CompiledModel,
    num_chains: int = 30,
    settings: HMCSettings = TRACKER,
    *,
    window: int = 3,
    num_starts: int = 40,
    num_mode_steps: int = 4,
) -> Filter:
    """HMC on the last few frames together, the older past summarised by a Gaussian: slower, and less is summarised.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        num_chains: M, Markov chains of a frame.
        settings: R, L, b, epsilon and so on.
        window: W, frames whose joint density the chains sample.
        num_starts: Draws from the prediction that climb to modes.
        num_mode_steps: Gauss-Newton steps of each, on the newest frame and again on the window.

    Returns:
        The filter; its state is :class:`WindowState`. ``log_evidence`` is Laplace's approximation at the newest frame's highest
        mode; likelihoods and gradients are counted by the frame.

    Raises:
        UnsuitableModelError: A site of the state has no noise.
        ValueError: A number out of range.
    """
    check_noise(model)
    settings = settings.check()
    check_at_least(1, num_chains=num_chains, window=window, num_starts=num_starts)
    check_at_least(0, num_mode_steps=num_mode_steps)
    dimension = model.dimension

    def step(
        rng_key: Array, state: WindowState, observation: Observation, inputs: Any = None
    ) -> tuple[WindowState, FilterInfo]:
        first, predicted = state.window.num_frames == 0, predict(model, state.particles, inputs)
        initial = jax.tree.map(lambda leaf: leaf[-1], state.window.predictions)
        prediction: Gaussian = jax.tree.map(lambda a, b: jnp.where(first, a, b), initial, predicted)
        key_climb, key_past, key_chains, key_even = jax.random.split(rng_key, 4)
        prior = GaussianMixture(jnp.zeros(1, prediction.mean.dtype), prediction.mean[None], prediction.covariance[None])
        starts, _ = draw_mixture(key_climb, prior, num_starts)
        starts = starts.at[0].set(prediction.mean)
        failed = ~jnp.any(jnp.isfinite(log_likelihoods(model, starts, observation, inputs)))
        seen = _masked(model, mask_failed(model, observation, failed))
        frames = move_on(state.window, prediction, seen, inputs)
        precision = precision_of(prediction.covariance)
        newest = find_modes(
            starts,
            lambda x: model.log_observation(x, seen, inputs) + log_mixture(prior)(x),
            lambda x: precision + model.observation_information(x, seen, inputs),
            num_mode_steps,
        )
        target = window_target(model, frames)
        pasts = _pasts(model, key_past, state, newest.states, inputs)
        whole = find_modes(
            jnp.concatenate([pasts, newest.states[:, None]], 1).reshape(num_starts, -1),
            target.log_density,
            lambda x: target.prior_precision + target.information(x),
            num_mode_steps,
        )
        modes = whole._replace(log_masses=mode_log_weights(whole))
        draws, log_weights, chains = chains_from_modes(
            key_chains, modes, target.log_density, state.log_step_size, num_chains, settings
        )
        even = draws[systematic(key_even, log_weights, num_chains)]
        trajectories = even.reshape(*draws.shape[:2], window, dimension)
        particles = trajectories[:, :, -1]
        info = _info(particles, chains, jnp.max(newest.log_masses), failed, window, num_starts, num_mode_steps)
        log_weights = jnp.zeros(particles.shape[:-1], particles.dtype)
        return WindowState(particles, log_weights, chains.log_step_size, trajectories, frames), info

    def initial_state(observation: Observation, inputs: Any = None) -> WindowState:
        empty = empty_window(model, window, inputs)
        mean = empty.predictions.mean
        nothing = jnp.broadcast_to(mean, (num_chains, settings.num_updates - settings.num_warmup, window, dimension))
        log_step_size = jnp.log(jnp.asarray(settings.step_size, mean.dtype))
        return WindowState(nothing[:, :, -1], jnp.zeros(nothing.shape[:2], mean.dtype), log_step_size, nothing, empty)

    return filter_of_steps(initial_state, step, differentiable=False)


def predict(model: CompiledModel, draws: Array, inputs: Any) -> Gaussian:
    """Moments of the next frame from draws (M, R, d) of this one, the spread of their means inflated."""
    means, covariances = transition_moments(model, draws.reshape(-1, draws.shape[-1]), inputs)
    mean = jnp.mean(means, 0)
    centred = means - mean
    spread = centred.T @ centred / max(means.shape[0] - 1, 1)
    return Gaussian(mean, spread * covariance_inflation(means.reshape(draws.shape)) + jnp.mean(covariances, 0))


def _masked(model: CompiledModel, observation: Observation) -> Observation:
    """The data with a value of our own wherever nothing was seen: the state remembers them."""
    nothing = model.unobserved()
    values = jax.tree.map(jnp.where, observation.mask, observation.values, nothing.values)
    return Observation(values, observation.mask)


def _pasts(model: CompiledModel, rng_key: Array, past: WindowState, newest: Array, inputs: Any) -> Array:
    """For each state of the newest frame (S, d) the window's frames before it (S, W - 1, d).

    Every other one is moved as a whole, so that it leads to the newest state: from a mode that no trajectory came to, the climb
    would not find back to a past of its own.
    """
    trajectories = past.trajectories.reshape(-1, *past.trajectories.shape[2:])
    chosen = jax.random.categorical(rng_key, log_transition_matrix(model, newest, trajectories[:, -1], inputs))
    pasts = trajectories[chosen]
    leads_to, _ = transition_moments(model, pasts[:, -1], inputs)
    moved = jnp.arange(newest.shape[0])[:, None] % 2 == 1
    return pasts[:, 1:] + jnp.where(moved, newest - leads_to, 0.0)[:, None]


def _info(
    particles: Array,
    chains: Chains,
    log_evidence: Array,
    failed: Array,
    window: int,
    num_starts: int,
    num_mode_steps: int,
) -> FilterInfo:
    num_chains = particles.shape[0]
    climbs = num_starts * (num_mode_steps + 1) * (1 + window)
    return filter_info(
        jnp.where(failed, -jnp.inf, log_evidence),
        effective_draws(particles),
        num_chains,
        failed,
        acceptance=chains.acceptance,
        divergences=chains.divergences,
        num_likelihood=GAUSS_NEWTON_TRIALS * climbs + num_starts + window * num_chains * CANDIDATES,
        num_gradient=window * chains.num_gradient + climbs,
        step_size=jnp.exp(chains.log_step_size),
    )


def covariance_inflation(draws: Array) -> Array:
    """Factor by which the inverse of the covariance of draws (M, R, d) is too large on average, from 1 to 2.

    It is (n - 1) / (n - d - 2) for n effective draws (Hartlap, Simon and Schneider 2007, doi:10.1051/0004-6361:20066170).
    """
    effective = effective_draws(draws)
    return jnp.clip((effective - 1) / jnp.maximum(effective - draws.shape[-1] - 2, 1.0), 1.0, 2.0)
