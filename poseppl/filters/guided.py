r"""The guided and the auxiliary particle filter: proposals that have seen the frame's data.

:mod:`poseppl.filters.sequential_monte_carlo` with a proposal q(x_t | x_(t-1), z_t) (Doucet, Godsill and Andrieu 2000,
doi:10.1023/A:1008935410038); the auxiliary filter also resamples by what the data say of each ancestor, \lambda.

The ready-made proposal, and \lambda, are from a local linearisation of the model (:mod:`poseppl.filters.local_proposal`),
optimal for linear Gaussian programs; of a state with finite sites only the real ones are linearised, given the finite ones
(:mod:`poseppl.filters.conditional_proposal`). A user's own is a NumPyro program (:class:`~poseppl.program.proposal.Proposal`).
The estimate of the evidence is unbiased with any proposal that is positive where the posterior is; how much it varies is
another matter: a proposal with lighter tails than the posterior makes rare, huge weights.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.filters.adaptive_resampling import adaptive_resampling
from poseppl.filters.base import Filter, check_noise
from poseppl.filters.conditional_proposal import conditional_draw
from poseppl.filters.local_proposal import local_proposal
from poseppl.filters.sequential_monte_carlo import Draw, Lookahead, smc_filter
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import Scheme
from poseppl.program import CompiledModel, Observation, Proposal
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.proposal import propose_initial, propose_transition


@memoized_builder
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
        model: The compiled model; without a `proposal`, or with `auxiliary`, its initial and transition programs with Gaussian
            moments, given its finite sites; `auxiliary` takes none of these.
        num_particles: N, at least 1.
        proposal: Programs to draw from; a local linearisation of the model if None.
        auxiliary: Whether ancestors are chosen by what the data say of them.
        resampling: How ancestors are drawn.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.

    Returns:
        The filter; its state is :class:`~poseppl.filters.sequential_monte_carlo.ParticleState`. `FilterInfo.ess` of the
        auxiliary
        filter is the lesser of its two stages': that of the weights that ancestors were chosen by, and that of the particles'
        own.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
        UnsuitableModelError: `auxiliary` for a model with finite sites, or without a `proposal` a site without noise.
    """
    if proposal is None:
        check_noise(model)
    if auxiliary and model.finite_sites:
        raise UnsuitableModelError(
            f"The auxiliary filter linearises whole states, and {model.finite_sites[0]!r} takes integers. Leave auxiliary out."
        )

    def propose(previous: Array | None, observation: Observation, inputs: Any) -> Lookahead:
        frame = previous, observation, inputs
        if proposal is None and model.finite_sites:
            return Lookahead(_given_finite(model, *frame, num_particles), None, num_particles)
        if proposal is None:
            lookahead = _linearised(model, num_particles, *frame)
        elif auxiliary and previous is not None:
            lookahead = _linearised(model, num_particles, *frame)._replace(draw=_program(model, proposal, *frame))
        else:
            lookahead = Lookahead(_program(model, proposal, *frame))
        return lookahead if auxiliary else lookahead._replace(log_predictive=None)

    return smc_filter(model, propose, adaptive_resampling(num_particles, resampling, ess_threshold))


def _linearised(
    model: CompiledModel, num_particles: int, previous: Array | None, observation: Observation, inputs: Any
) -> Lookahead:
    """Proposals around the predictions of the particles; at the first frame one for all."""
    if previous is None:
        dummy = jnp.zeros((1, model.dimension))
        one = local_proposal(model, lambda x: model.initial_moments(inputs), dummy, observation, inputs)
        return Lookahead(lambda key, _: one.draw(key, jnp.zeros(num_particles, jnp.int32)), None, num_particles)
    local = local_proposal(model, lambda x: model.transition_moments(x, inputs), previous, observation, inputs)
    return Lookahead(local.draw, local.log_predictive, num_particles)


def _given_finite(
    model: CompiledModel, previous: Array | None, observation: Observation, inputs: Any, num_particles: int
) -> Draw:
    """Draws of finite sites from the program, and of the real ones around the prediction that is made given these."""

    def draw(rng_key: Array, ancestors: Array) -> tuple[Array, Array]:
        keys = jax.random.split(rng_key, num_particles)
        return conditional_draw(model, keys, None if previous is None else previous[ancestors], observation, inputs)

    return draw


def _program(model: CompiledModel, proposal: Proposal, previous: Array | None, observation: Observation, inputs: Any) -> Draw:
    """Draws from a user's program."""
    build = propose_initial if previous is None else propose_transition
    proposing = build(model, proposal, observation, inputs)

    def draw(rng_key: Array, ancestors: Array) -> tuple[Array, Array]:
        before = () if previous is None else (previous[ancestors],)
        particles = jax.vmap(proposing.sample)(particle_keys(rng_key, ancestors.shape[0]), *before)
        if model.finite_sites:  # whose draws have no derivative: that of the weights alone is right
            particles = jax.lax.stop_gradient(particles)
            return particles, jax.lax.stop_gradient(jax.vmap(proposing.log_density)(particles, *before))
        return particles, jax.vmap(proposing.log_density)(particles, *before)

    return draw
