r"""The guided and the auxiliary particle filter: proposals that have seen the frame's data.

States are drawn from q(x_t | x_(t-1), z_t) and weighted by p(z_t | x_t) p(x_t | x_(t-1)) / q (Doucet, Godsill and Andrieu 2000,
doi:10.1023/A:1008935410038). The auxiliary filter (Pitt and Shephard 1999, doi:10.1080/01621459.1999.10474153) also resamples
by what the data say of each ancestor, an estimate \lambda_i of p(z_t | x_(t-1)^(i)), and divides by it afterwards:

    a_i ~ w_j \lambda_j,    w_i = p(z_t | x_i) p(x_i | x_(t-1)^(a_i)) / (q(x_i) \lambda_(a_i)) sum_j w_j \lambda_j / N.

The ready-made proposal, and \lambda, are from a local linearisation of the model (:mod:`poseppl.filters.local_proposal`),
optimal for linear Gaussian programs; a user's own is a NumPyro program (:class:`~poseppl.program.proposal.Proposal`). The
estimate of the evidence is unbiased with any proposal that is positive where the posterior is; how much it varies is another
matter: a proposal with lighter tails than the posterior makes rare, huge weights.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from poseppl.filters.adaptive_resampling import Ancestry, adaptive_resampling
from poseppl.filters.base import Filter, Info
from poseppl.filters.local_proposal import LocalProposal, local_proposal
from poseppl.filters.particle import ParticleState
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import Scheme
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation, Proposal
from poseppl.program.proposal import Proposing, propose_initial, propose_transition


class _Outlook(NamedTuple):
    """What the data say before a frame's states are drawn.

    Attributes:
        draw: `(rng_key, ancestors (N,)) -> states (N, d) and their log-densities (N,)`.
        log_first: Log lambda (N,) of each particle as an ancestor.
        num_gradient: Gradients of the likelihood that it took.
    """

    draw: Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]
    log_first: jax.Array
    num_gradient: int


def guided_filter(
    model: CompiledModel,
    num_particles: int = 2000,
    *,
    proposal: Proposal | None = None,
    auxiliary: bool = False,
    resampling: Scheme = "systematic",
    ess_threshold: float = 1.0,
) -> Filter:
    """The guided or auxiliary particle filter: particles are drawn from a linearisation that has seen the frame.

    Args:
        model: The compiled model; without a `proposal`, or with `auxiliary`, its sites over the real line and its initial and
            transition programs with Gaussian moments.
        num_particles: N, at least 1.
        proposal: Programs to draw from; a local linearisation of the model if None.
        auxiliary: Whether ancestors are chosen by what the data say of them.
        resampling: One of systematic, stratified, residual, multinomial.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.

    Returns:
        The filter; its state is :class:`~poseppl.filters.particle.ParticleState`. `Info.ess` of the auxiliary filter is the
        lesser of its two stages': that of the weights that ancestors were chosen by, and that of the particles' own.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
    """
    adaptive = adaptive_resampling(num_particles, resampling, ess_threshold)

    def draw_program(proposing: Proposing, rng_key: jax.Array, *before: jax.Array) -> tuple[jax.Array, jax.Array]:
        particles = jax.vmap(proposing.sample)(particle_keys(rng_key, num_particles), *before)
        return particles, jax.vmap(proposing.log_density)(particles, *before)

    def look_ahead(previous: jax.Array, observation: Observation, inputs: Any) -> _Outlook:
        def linearised() -> LocalProposal:
            return local_proposal(model, lambda x: model.transition_moments(x, inputs), previous, observation, inputs)

        indifferent = jnp.zeros(num_particles, previous.dtype)
        if proposal is None:
            local = linearised()
            return _Outlook(local.draw, local.log_predictive if auxiliary else indifferent, num_particles)
        proposing = propose_transition(model, proposal, observation, inputs)
        outlook = _Outlook(lambda key, chosen: draw_program(proposing, key, previous[chosen]), indifferent, 0)
        if auxiliary:
            return outlook._replace(log_first=linearised().log_predictive, num_gradient=num_particles)
        return outlook

    def weigh(
        particles: jax.Array,
        log_ratio: jax.Array,
        ancestry: Ancestry,
        observation: Observation,
        inputs: Any,
        num_gradient: int,
        first_stage: jax.Array | float,
    ) -> tuple[ParticleState, Info]:
        """Weights from log p(x | x') - log q(x) (N,) and the likelihood; the ESS of the ancestors' choice bounds theirs."""
        log_likelihood = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(particles)
        updated = normalise(ancestry.log_weights + log_ratio + log_likelihood)
        # after impossible data the particles count as draws of the prediction, by their importance without the likelihood
        predicted = normalise(ancestry.log_weights + log_ratio)
        log_weights = jnp.where(updated.degenerate, predicted.log_weights, updated.log_weights)
        info = Info(
            log_evidence=updated.log_mean + jnp.log(jnp.asarray(num_particles, log_weights.dtype)),
            ess=jnp.minimum(first_stage, jnp.where(updated.degenerate, jnp.maximum(predicted.ess, 1.0), updated.ess)),
            ancestors=ancestry.ancestors,
            acceptance=jnp.ones((), log_weights.dtype),
            divergences=jnp.zeros((), jnp.int32),
            num_likelihood=jnp.asarray(num_particles, jnp.int32),
            num_gradient=jnp.asarray(num_gradient, jnp.int32),
            failed=updated.degenerate,
            step_size=jnp.full((), jnp.nan, log_weights.dtype),
        )
        return ParticleState(particles, log_weights), info

    def init(rng_key: jax.Array, observation: Observation, inputs: Any = None) -> tuple[ParticleState, Info]:
        if proposal is None:
            nowhere = jnp.zeros((1, model.dimension), jnp.result_type(float))
            local = local_proposal(model, lambda x: model.initial_moments(inputs), nowhere, observation, inputs)
            particles, log_proposal = local.draw(rng_key, jnp.zeros(num_particles, jnp.int32))
        else:
            particles, log_proposal = draw_program(propose_initial(model, proposal, observation, inputs), rng_key)
        log_ratio = jax.vmap(lambda x: model.log_initial(x, inputs))(particles) - log_proposal
        uniform = Ancestry(adaptive.everyone(), jnp.full(num_particles, -jnp.log(num_particles), particles.dtype))
        num_gradient = num_particles if proposal is None else 0
        return weigh(particles, log_ratio, uniform, observation, inputs, num_gradient, num_particles)

    def step(
        rng_key: jax.Array, state: ParticleState, observation: Observation, inputs: Any = None
    ) -> tuple[ParticleState, Info]:
        key_resample, key_predict = jax.random.split(rng_key)
        outlook = look_ahead(state.particles, observation, inputs)
        staged = normalise(state.log_weights + outlook.log_first)
        # resampled by w lambda, a child starts with the total over N lambda
        log_start = staged.log_mean - outlook.log_first
        ancestry = adaptive.choose(key_resample, staged.log_weights, log_start, state.log_weights)
        previous = state.particles[ancestry.ancestors]
        particles, log_proposal = outlook.draw(key_predict, ancestry.ancestors)
        log_prior = jax.vmap(lambda x, before: model.log_transition(x, before, inputs))(particles, previous)
        chosen = auxiliary & (staged.ess <= ess_threshold * num_particles)
        first_stage = jnp.where(chosen, staged.ess, num_particles)
        log_ratio = log_prior - log_proposal
        return weigh(particles, log_ratio, ancestry, observation, inputs, outlook.num_gradient, first_stage)

    return Filter(init, step, genealogy=True)
