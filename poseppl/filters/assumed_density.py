"""The HMC filter with an assumed-density temporal prior: the default tracker.

The prior of Choo and Fleet's filter is a mixture over the last state of each of M chains. In 28 dimensions its M narrow
components keep the chains near their ancestors, and the intervals are too narrow. Here the posterior of the last frame is
summarised by a mixture of K Gaussians, fitted to all draws of all chains after the warm-up. The prior is the image of this
mixture under the transition, by its first two moments given each draw. With K = 1:

    m = mean of E[x_t | x],    P = cov of E[x_t | x] + mean of Cov[x_t | x],    x over the draws.

A frame seen by one camera has many modes (each limb may lean towards the camera or away), and chains seldom cross between them.
So the chains start in all of them. Some draws from the prior, and most draws of the last frame after a step of the transition,
climb to their nearest modes by Gauss-Newton. Each chain starts from the Laplace approximation of one of these modes. Modes get
chains in proportion to their masses, by systematic resampling, which has the smallest variance: a mode without a chain in some
frame would be lost. The frame's target N(x; m, P) p(z_t | x) is then sampled in coordinates whitened by the curvature of the
posterior, averaged over the modes.

A covariance estimated from n effective draws in d dimensions has too large an inverse, by (n - 1) / (n - d - 2) on average
(Hartlap, Simon and Schneider 2007, doi:10.1051/0004-6361:20066170), and without a correction the filter becomes overconfident
from frame to frame. So each component has the density of a Gaussian whose covariance is known from n draws alone, a
multivariate t (:mod:`poseppl.gaussians.mixture`). Here n is the number of effective draws of all chains, from the variance of
their means. If steps are small relative to the posterior, as in a slow random walk, intervals are far too narrow without it
(studies/inflation.py); on simulated motion the coverage is closer to its level with it (studies/windows.py).

With K = 1 it is exact for linear Gaussian models up to the Monte Carlo error of m and P.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.checks import check_at_least, check_fraction
from poseppl.filters.base import Filter, FilterInfo, filter_info, filter_of_steps
from poseppl.filters.chains import ChainState, LogDensity, chain_state, effective_draws, effective_share, mask_failed
from poseppl.filters.mode_chains import CANDIDATES, MODE_POWER, chains_from_modes
from poseppl.gaussians.chain_mixture import fit_mixture
from poseppl.gaussians.mixture import (
    GaussianMixture,
    MixtureFactors,
    draw_mixture,
    factorise_mixture,
    log_mixture,
    mixture_curvature,
)
from poseppl.kernels.hmc import HMCSettings
from poseppl.kernels.laplace import GAUSS_NEWTON_TRIALS, find_modes, mode_log_weights
from poseppl.particles.keys import particle_keys
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import log_likelihoods, propagate, transition_moments

TRACKER = HMCSettings(num_updates=24, num_leapfrog=8, num_warmup=4, step_size=0.4, target_acceptance=0.85, jitter=0.5)
"""The default chains: trajectories of 4 to 8 steps are long enough in whitened coordinates."""
_MOVED = 0.9
"""Share of the starts that set out from draws of the last frame."""
_MIN_FREEDOM, _MAX_DRAWS = 4.0, 1e6
"""Degrees of freedom, n - d, that a component has at least; and how many draws an exact covariance stands for."""


@memoized_builder
def assumed_density_filter(
    model: CompiledModel,
    num_chains: int = 30,
    settings: HMCSettings = TRACKER,
    *,
    num_components: int = 3,
    num_starts: int = 40,
    num_mode_steps: int = 4,
    mode_power: float = MODE_POWER,
) -> Filter:
    """HMC with a few Gaussians, fitted to all draws, as the temporal prior: near-calibrated intervals in high dimension.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        num_chains: M, Markov chains of a frame.
        settings: R, L, b, epsilon and so on.
        num_components: K, Gaussians in the temporal prior.
        num_starts: States that climb to modes.
        num_mode_steps: Gauss-Newton steps of each.
        mode_power: Chains are shared among modes in proportion to this power of their masses, from 0 to 1: the smaller it is,
            the more chains a lesser mode has, whose weight stays the same.

    Returns:
        The filter; its state is :class:`~poseppl.filters.chains.ChainState`. ``log_evidence`` is the sum
        of Laplace's approximations at the modes that were found.
    """
    settings = settings.check()
    check_at_least(1, num_chains=num_chains, num_components=num_components, num_starts=num_starts)
    check_at_least(0, num_mode_steps=num_mode_steps)
    check_fraction("[0, 1]", mode_power=mode_power)
    moved = int(_MOVED * (num_starts - 1))

    def initial_state(observation: Observation, inputs: Any = None) -> ChainState:
        mean, _ = model.initial_moments(inputs)
        draws = jnp.broadcast_to(mean, (num_chains, settings.num_updates - settings.num_warmup, *mean.shape))
        return chain_state(draws, jnp.log(jnp.asarray(settings.step_size, mean.dtype)), started=False)

    def step(rng_key: Array, state: ChainState, observation: Observation, inputs: Any = None) -> tuple[ChainState, FilterInfo]:
        first = ~state.started
        prior, factors, log_prior = _prior(model, state, first, inputs, num_components)
        key_climb, key_move, key_chains = jax.random.split(rng_key, 3)
        starts, component = draw_mixture(key_climb, prior, num_starts, factors)
        others = jnp.where(first, starts[num_starts - moved :], _move(model, key_move, state.particles, inputs, moved))
        starts = jnp.concatenate([prior.means[component[:1]], starts[1 : num_starts - moved], others])
        prior_curvature = mixture_curvature(prior, factors)
        failed = ~jnp.any(jnp.isfinite(log_likelihoods(model, starts, observation, inputs)))
        seen = mask_failed(model, observation, failed)

        def log_density(x: Array) -> Array:
            return model.log_observation(x, seen, inputs) + log_prior(x)

        def curvature(x: Array) -> Array:
            return prior_curvature(x) + model.observation_information(x, seen, inputs)

        found = find_modes(starts, log_density, curvature, num_mode_steps)
        modes = found._replace(log_masses=mode_log_weights(found))
        draws, log_weights, chains = chains_from_modes(
            key_chains, modes, log_density, state.log_step_size, num_chains, settings, mode_power
        )
        info = filter_info(
            jnp.where(failed, -jnp.inf, jax.nn.logsumexp(modes.log_masses)),
            effective_draws(chains.draws) * effective_share(log_weights),
            num_chains,
            failed,
            acceptance=chains.acceptance,
            divergences=chains.divergences,
            num_likelihood=num_starts * (GAUSS_NEWTON_TRIALS * (num_mode_steps + 1) + 1) + num_chains * CANDIDATES,
            num_gradient=chains.num_gradient + num_starts * (num_mode_steps + 1),
            step_size=jnp.exp(chains.log_step_size),
        )
        return chain_state(draws, chains.log_step_size, log_weights=log_weights), info

    return filter_of_steps(initial_state, step, differentiable=False)


def _prior(
    model: CompiledModel, state: ChainState, first: Array, inputs: Any, num_components: int
) -> tuple[GaussianMixture, MixtureFactors, LogDensity]:
    """The Gaussians that sum up the past, their factors, and the prior log-density: at first that of the initial program.

    If the initial program is Gaussian, its moments are that density.
    """
    means, covariances = jax.vmap(lambda chain: transition_moments(model, chain, inputs))(state.particles)
    fitted, residuals = fit_mixture(means, num_components, state.log_weights[:, 0])
    noise = jnp.einsum("mr,mrij->ij", jax.nn.softmax(state.log_weights, (0, 1)), covariances)
    predicted = fitted._replace(covariances=fitted.covariances + noise)
    mean, covariance = model.initial_moments(inputs)
    number = len(predicted.log_weights)
    initial = GaussianMixture(
        jnp.full(number, -np.log(number), mean.dtype), *(jnp.stack([m] * number) for m in (mean, covariance))
    )
    prior: GaussianMixture = jax.tree.map(lambda a, b: jnp.where(first, a, b), initial, predicted)
    factors = factorise_mixture(prior, jnp.where(first, _MAX_DRAWS, draws_of_covariances(residuals)))
    log_predicted = log_mixture(prior, factors)
    if model.initial_is_gaussian(inputs):
        return prior, factors, log_predicted

    def log_prior(x: Array) -> Array:
        # the inner choice keeps what is not chosen finite, and with it its gradient
        return jnp.where(first, model.log_initial(jnp.where(first, x, mean), inputs), log_predicted(x))

    return prior, factors, log_prior


def _move(model: CompiledModel, rng_key: Array, draws: Array, inputs: Any, number: int) -> Array:
    """Draws (number, d) of the next frame from some of the draws (M, R, d) of this one, of each chain in turn."""
    key_choose, key_move = jax.random.split(rng_key)
    num_chains, num_draws, _ = draws.shape
    chances = jax.random.uniform(key_choose, (number + 1,), draws.dtype)
    # the first number turns the chains, so that each is as likely as any other to be taken once more
    chain = (jnp.arange(number) + (chances[0] * num_chains).astype(jnp.int32)) % num_chains
    chosen = draws[chain, (chances[1:] * num_draws).astype(jnp.int32)]
    return propagate(model, particle_keys(key_move, number), chosen, inputs)


def draws_of_covariances(residuals: Array) -> Array:
    """Effective draws that covariances are estimated from, a scalar, given draws (M, R, d) less their components' means."""
    return jnp.clip(effective_draws(residuals), residuals.shape[-1] + _MIN_FREEDOM, _MAX_DRAWS)
