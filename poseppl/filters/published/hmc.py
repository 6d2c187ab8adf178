"""The hybrid Monte Carlo filter of Choo and Fleet 2001, section 5.

M Markov chains, each of R updates a frame. A frame begins as a particle filter does: every chain's last state s_i is moved by
the transition, and the M proposals are resampled by their likelihoods (steps 1 and 2); these are the chains' first states. Then
R updates leave invariant (steps 3 and 4)

    P_t(x) = p(z_t | x) 1/M sum over i of p(x | s_i)          (Eqs. 9 and 10):

the prior is the mixture over the last states of all chains, not the chain's own ancestor. Step sizes differ by coordinate as in
Eq. 17, from the Gauss-Newton curvature of the posterior at the predicted mean, which does not depend on a chain's own state; a
dense mass matrix from the same curvature is an option.

The mixture of M points cannot carry a posterior over many frames in high dimension: chains stay with their ancestor and
intervals are too narrow. :mod:`poseppl.filters.assumed_density` corrects that.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.base import Filter, FilterInfo, check_noise, filter_info
from poseppl.filters.chains import ChainState, LogDensity, chain_state, effective_draws, mask_failed
from poseppl.kernels.hmc import HMCSettings, hmc_chains
from poseppl.kernels.laplace import Whitening, whitening
from poseppl.particles.resampling import Scheme, resampling_scheme
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.population import draw_initial, log_likelihoods, log_prediction, propagate, transition_moments

PAPER = HMCSettings()
"""The paper's 28-D row of Table 1, with an adapted step size."""


class _Prediction(NamedTuple):
    """A frame before its data: `log_density` of a state, and its mean (d,) and covariance (d, d)."""

    log_density: LogDensity
    mean: Array
    covariance: Array


@memoized_builder
def hmc_filter(
    model: CompiledModel,
    num_chains: int = 10,
    settings: HMCSettings = PAPER,
    *,
    dense_mass: bool = False,
    curvature: Array | None = None,
    resampling: Scheme = "systematic",
) -> Filter:
    """The HMC filter of Choo and Fleet 2001: the temporal prior is a mixture over the last state of every chain.

    Args:
        model: The compiled model, its initial and transition programs with Gaussian moments.
        num_chains: M, Markov chains of a frame.
        settings: R, L, b, epsilon and so on.
        dense_mass: Whether the mass matrix has the curvature's off-diagonal entries.
        curvature: Second derivatives of the energy by coordinate (d,), to be used for Eq. 17 instead of our estimate.
        resampling: How step 2 resamples.

    Returns:
        The filter; its state is :class:`~poseppl.filters.chains.ChainState`.
    """
    check_noise(model)
    settings = settings.check()
    check_at_least(1, num_chains=num_chains)
    scheme = resampling_scheme(resampling)

    def run(
        rng_key: Array,
        proposals: Array,
        predicted: _Prediction,
        log_step_size: Array,
        observation: Observation,
        inputs: Any,
    ) -> tuple[ChainState, FilterInfo]:
        key_resample, key_chains = jax.random.split(rng_key)
        weights = log_likelihoods(model, proposals, observation, inputs)
        failed = ~jnp.any(jnp.isfinite(weights))
        seen = mask_failed(model, observation, failed)
        weights = jnp.where(failed | jnp.isnan(weights), jnp.where(failed, 0.0, -jnp.inf), weights)
        ancestors = scheme(key_resample, weights, num_chains)
        transform = _whitening(model, predicted, seen, inputs, dense_mass, curvature)

        def log_density(z: Array) -> Array:
            x = transform.to_state(z)
            return model.log_observation(x, seen, inputs) + predicted.log_density(x)

        chains = hmc_chains(key_chains, transform.to_white(proposals[ancestors]), log_density, log_step_size, settings)
        info = filter_info(
            jnp.where(failed, -jnp.inf, jax.nn.logsumexp(weights) - jnp.log(num_chains)),
            effective_draws(chains.draws),
            ancestors,
            failed,
            acceptance=chains.acceptance,
            divergences=chains.divergences,
            num_likelihood=num_chains,
            num_gradient=chains.num_gradient,
            step_size=jnp.exp(chains.log_step_size),
        )
        return chain_state(transform.to_state(chains.draws), chains.log_step_size), info

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[ChainState, FilterInfo]:
        key_draw, key_run = jax.random.split(rng_key)
        predicted = _Prediction(lambda x: model.log_initial(x, inputs), *model.initial_moments(inputs))
        proposals = draw_initial(model, jax.random.split(key_draw, num_chains), inputs)
        start = jnp.log(jnp.asarray(settings.step_size, proposals.dtype))
        return run(key_run, proposals, predicted, start, observation, inputs)

    def step(rng_key: Array, state: ChainState, observation: Observation, inputs: Any = None) -> tuple[ChainState, FilterInfo]:
        key_draw, key_run = jax.random.split(rng_key)
        last = state.particles[:, -1]
        proposals = propagate(model, jax.random.split(key_draw, num_chains), last, inputs)
        means, covariances = transition_moments(model, last, inputs)
        mixture = partial(log_prediction, model, previous=last, inputs=inputs)
        predicted = _Prediction(mixture, jnp.mean(means, 0), jnp.mean(covariances, 0))
        return run(key_run, proposals, predicted, state.log_step_size, observation, inputs)

    return Filter(init, step, points=num_chains, differentiable=False)


def _whitening(
    model: CompiledModel,
    predicted: _Prediction,
    observation: Observation,
    inputs: Any,
    dense: bool,
    curvature: Array | None,
) -> Whitening:
    """Coordinates in which Eq. 17's step sizes are all epsilon."""
    mean = predicted.mean
    if curvature is not None:
        return Whitening(mean, 1.0 / jnp.sqrt(jnp.asarray(curvature, mean.dtype)))
    information = model.observation_information(mean, observation, inputs)
    return whitening(mean, jnp.linalg.inv(predicted.covariance) + information, dense=dense)
