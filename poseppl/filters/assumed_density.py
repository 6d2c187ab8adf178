"""The HMC filter with an assumed-density temporal prior: the default tracker.

The prior of Choo and Fleet's filter is a mixture over the last state of each of M chains; in 28 dimensions its M narrow bumps
hold the chains near their ancestors, and the intervals come out too narrow. Here the posterior of the last frame is summarised
by a Gaussian (or a small mixture of K) fitted to all draws of all chains after burn-in, and the prior is its image under the
transition, by its first two moments given each draw:

    m = mean of E[x_t | x],    P = cov of E[x_t | x] + mean of Cov[x_t | x],    x over the draws.

The frame's target N(x; m, P) p(z_t | x) is sampled in coordinates whitened by its Gauss-Newton curvature at its mode, the chains
starting from the Laplace approximation there. It is exact for linear Gaussian models up to the Monte Carlo error of m and P.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from poseppl.filters.base import Filter, Info
from poseppl.filters.chains import ChainState, LogDensity, chain_state, drop_impossible, initial_moments
from poseppl.gaussian import GaussianMixture, fit_mixture, log_mixture
from poseppl.kernels.hmc import HMCSettings, hmc_chains
from poseppl.kernels.laplace import GAUSS_NEWTON_TRIALS, gauss_newton_mode, whitening
from poseppl.program import CompiledModel, Observation

TRACKER = HMCSettings(num_updates=32, num_leapfrog=16, burn_in=6, step_size=0.3, target_rejection=0.15, jitter=0.5)
"""The default chains: L of 8 to 16 is long enough in whitened coordinates."""


def assumed_density_filter(
    model: CompiledModel,
    num_chains: int = 10,
    settings: HMCSettings = TRACKER,
    *,
    num_components: int = 1,
    num_mode_steps: int = 4,
) -> Filter:
    """Build the filter.

    Args:
        model: The compiled model, its sites over the real line and its transition with Gaussian moments.
        num_chains: M.
        settings: R, L, b, epsilon and so on.
        num_components: K, Gaussians in the temporal prior.
        num_mode_steps: Gauss-Newton steps to each frame's mode.

    Returns:
        The filter; its state is :class:`~poseppl.filters.chains.ChainState`. ``log_evidence`` is Laplace's approximation.
    """
    settings = settings.check()
    if num_chains < 1 or num_components < 1:
        raise ValueError(f"num_chains is {num_chains} and num_components {num_components}; both must be at least 1")

    def run(
        rng_key: jax.Array,
        prior: GaussianMixture,
        log_prior: LogDensity,
        log_step_size: jax.Array,
        observation: Observation,
        inputs: Any,
    ) -> tuple[ChainState, Info]:
        key_start, key_component, key_chains = jax.random.split(rng_key, 3)
        possible = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(prior.means)
        failed = ~jnp.any(jnp.isfinite(possible))
        seen = drop_impossible(model, observation, failed)

        def log_density(x: jax.Array) -> jax.Array:
            return model.log_observation(x, seen, inputs) + log_prior(x)

        def information(x: jax.Array) -> jax.Array:
            return model.observation_information(x, seen, inputs)

        def climb(mean: jax.Array, inverse: jax.Array) -> jax.Array:
            return gauss_newton_mode(mean, log_density, lambda x: inverse + information(x), num_mode_steps)

        inverses = jnp.linalg.inv(prior.covariances)
        modes = jax.vmap(climb)(prior.means, inverses)
        heights = jax.vmap(log_density)(modes)
        best = jnp.argmax(heights)
        chart = whitening(modes[best], inverses[best] + information(modes[best]))
        share = jax.random.categorical(key_component, heights - jnp.max(heights), shape=(num_chains,))
        noise = jax.random.normal(key_start, (num_chains, model.dimension), chart.centre.dtype)
        starts = noise + chart.to_white(modes[share])

        chains = hmc_chains(key_chains, starts, lambda z: log_density(chart.to_state(z)), log_step_size, settings)
        log_volume = jnp.sum(jnp.log(jnp.abs(jnp.diagonal(chart.scale))))
        evidence = heights[best] + 0.5 * model.dimension * jnp.log(2 * jnp.pi) + log_volume
        num_kept = chains.draws.shape[0] * chains.draws.shape[1]
        info = Info(
            log_evidence=jnp.where(failed, -jnp.inf, evidence),
            ess=jnp.asarray(num_kept, evidence.dtype),
            ancestors=jnp.arange(num_chains, dtype=jnp.int32),
            acceptance=chains.acceptance,
            divergences=chains.divergences,
            num_likelihood=jnp.int32(num_components * (GAUSS_NEWTON_TRIALS * num_mode_steps + 2)),
            num_gradient=chains.num_gradient + num_components * num_mode_steps,
            failed=failed,
            step_size=jnp.exp(chains.log_step_size),
        )
        return chain_state(chart.to_state(chains.draws), chains.log_step_size), info

    def init(rng_key: jax.Array, observation: Observation, inputs: Any) -> tuple[ChainState, Info]:
        key_moments, key_run = jax.random.split(rng_key)
        mean, covariance = initial_moments(model, key_moments, inputs)
        prior = GaussianMixture(jnp.zeros(1, mean.dtype), mean[None], covariance[None])
        start = jnp.log(jnp.asarray(settings.step_size, mean.dtype))
        return run(key_run, prior, lambda x: model.log_initial(x, inputs), start, observation, inputs)

    def step(rng_key: jax.Array, state: ChainState, observation: Observation, inputs: Any) -> tuple[ChainState, Info]:
        key_fit, key_run = jax.random.split(rng_key)
        draws = state.particles.reshape(-1, model.dimension)
        means, covariances = jax.vmap(lambda x: model.transition_moments(x, inputs))(draws)
        fitted = fit_mixture(key_fit, means, num_components)
        prior = fitted._replace(covariances=fitted.covariances + jnp.mean(covariances, 0))
        return run(key_run, prior, log_mixture(prior), state.log_step_size, observation, inputs)

    return Filter(init, step)
