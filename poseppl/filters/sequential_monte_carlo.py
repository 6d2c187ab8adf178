r"""Sequential Monte Carlo with a proposal: the one filter behind the particle, the guided and the auxiliary filter.

With a proposal q and, of the auxiliary filter (Pitt and Shephard 1999, doi:10.1080/01621459.1999.10474153), an estimate
\lambda_i of p(z_t | x_(t-1)^(i)), for each frame t:

1. resample: when the ESS is at or below the threshold, a_i ~ w_j \lambda_j, and the weights become sum_j w_j \lambda_j / (N
   \lambda_(a_i)); without looking ahead \lambda is 1;
2. propose: x_i ~ q(x_t | x_(t-1)^(a_i), z_t);
3. weigh: w_i is proportional to its old weight times p(z_t | x_i) p(x_i | x_(t-1)^(a_i)) / q(x_i).

The evidence increment is the log of the sum of the products in step 3. The product of these sums over the frames is an unbiased
estimate of p(z_1..t), with resampling at every frame or only at some. The proposal has to be positive wherever the posterior
is.

If no particle can explain a frame (every weight zero or NaN), the frame is reported as failed. Its particles are then draws of
the prediction, with the weights that they had before the likelihood.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.filters.adaptive_resampling import AdaptiveResampling, Ancestry
from poseppl.filters.base import Filter, FilterInfo, filter_info
from poseppl.particles.weights import weigh
from poseppl.program import CompiledModel, Observation
from poseppl.program.population import differentiable_draws, log_initials, log_likelihoods, log_transitions


class ParticleState(NamedTuple):
    """Weighted particles.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights (N,).
    """

    particles: Array
    log_weights: Array


Draw = Callable[[Array, Array], tuple[Array, Array | None]]
"""`(rng_key, ancestors (N,)) -> states (N, d) and their log-densities (N,)`, None where the proposal is the
transition, whose density then cancels."""


class Lookahead(NamedTuple):
    """The proposals of a frame.

    Attributes:
        draw: Draws states.
        log_predictive: Log lambda (N,) of each particle as an ancestor, or None.
        num_gradient: Gradients of the likelihood that it took.
    """

    draw: Draw
    log_predictive: Array | None = None
    num_gradient: int = 0


Propose = Callable[[Array | None, Observation, Any], Lookahead]
"""`(particles, observation, inputs) -> Lookahead`; particles of the frame before (N, d), or None at the first frame."""


def smc_filter(model: CompiledModel, propose: Propose, adaptive: AdaptiveResampling) -> Filter:
    """Build the filter.

    Args:
        model: The compiled model.
        propose: The proposals.
        adaptive: How many particles, and when they are resampled.

    Returns:
        The filter; its state is :class:`ParticleState`. `FilterInfo.ess` is the lesser one of the weights that ancestors were
        drawn by, where these looked ahead, and of the particles' own.
    """

    def update(
        rng_key: Array,
        previous: Array | None,
        lookahead: Lookahead,
        ancestry: Ancestry,
        observation: Observation,
        inputs: Any,
    ) -> tuple[ParticleState, FilterInfo]:
        particles, log_proposal = lookahead.draw(rng_key, ancestry.ancestors)
        log_prior = ancestry.log_weights
        before = None if previous is None else previous[ancestry.ancestors]
        if log_proposal is None:
            particles, score = differentiable_draws(model, particles, before, inputs)
            log_prior = log_prior + score
        else:
            if before is None:
                log_density = log_initials(model, particles, inputs)
            else:
                log_density = log_transitions(model, particles, before, inputs)
            log_prior = log_prior + (log_density - log_proposal)
        weighed = weigh(log_prior, log_likelihoods(model, particles, observation, inputs))
        info = filter_info(
            weighed.log_evidence,
            jnp.minimum(ancestry.ess, weighed.ess),
            ancestry.ancestors,
            weighed.failed,
            num_likelihood=adaptive.num_particles,
            num_gradient=lookahead.num_gradient,
        )
        return ParticleState(particles, weighed.log_weights), info

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[ParticleState, FilterInfo]:
        uniform = jnp.full(adaptive.num_particles, -jnp.log(adaptive.num_particles))
        lookahead = propose(None, observation, inputs)
        return update(rng_key, None, lookahead, adaptive.keep(uniform), observation, inputs)

    def step(
        rng_key: Array, state: ParticleState, observation: Observation, inputs: Any = None
    ) -> tuple[ParticleState, FilterInfo]:
        key_resample, key_predict = jax.random.split(rng_key)
        lookahead = propose(state.particles, observation, inputs)
        ancestry = adaptive.choose(key_resample, state.log_weights, lookahead.log_predictive)
        return update(key_predict, state.particles, lookahead, ancestry, observation, inputs)

    return Filter(init, step, evidence="weights", genealogy=True)
