r"""The particle filter with the temporal prior as proposal (Gordon, Salmond and Smith 1993, doi:10.1049/ip-f-2.1993.0015).

Section 3 of Choo and Fleet 2001 (doi:10.1109/ICCV.2001.937643). For each frame t:

1. resample: when ESS / N is at or below the threshold, draw ancestors a_i by the weights w_(t-1) and set the weights to 1/N;
2. predict: x_i ~ p(x_t | x_(t-1)^(a_i));
3. weigh: w_i is proportional to its old weight times p(z_t | x_i).

The evidence increment is log sum_i w_i(old) p(z_t | x_i), with the old weights normalised: its exponential's product over the
frames is an unbiased estimate of p(z_1..t), with resampling at every frame or only at some.

If no particle can explain a frame (every weight zero or NaN) the frame is reported as failed and its particles stay as
predicted, with the weights that they had before the data.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from poseppl.filters.adaptive_resampling import Ancestry, adaptive_resampling
from poseppl.filters.base import Filter, Info
from poseppl.particles.keys import particle_keys
from poseppl.particles.resampling import Scheme
from poseppl.particles.weights import effective_sample_size, normalise
from poseppl.program import CompiledModel, Observation


class ParticleState(NamedTuple):
    """Weighted particles.

    Attributes:
        particles: Flat states (N, d).
        log_weights: Normalised log-weights (N,).
    """

    particles: jax.Array
    log_weights: jax.Array


def particle_filter(
    model: CompiledModel, num_particles: int = 10_000, *, resampling: Scheme = "systematic", ess_threshold: float = 1.0
) -> Filter:
    """The particle filter with the temporal prior as proposal.

    Args:
        model: The compiled model.
        num_particles: N, at least 1.
        resampling: One of systematic, stratified, residual, multinomial.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
    """
    adaptive = adaptive_resampling(num_particles, resampling, ess_threshold)

    def weigh(particles: jax.Array, ancestry: Ancestry, observation: Observation, inputs: Any) -> tuple[ParticleState, Info]:
        log_prior = ancestry.log_weights
        log_likelihood = jax.vmap(lambda x: model.log_observation(x, observation, inputs))(particles)
        updated = normalise(log_prior + log_likelihood)
        log_weights = jnp.where(updated.degenerate, log_prior, updated.log_weights)
        info = Info(
            log_evidence=updated.log_mean + jnp.log(jnp.asarray(num_particles, log_weights.dtype)),
            ess=jnp.where(updated.degenerate, effective_sample_size(log_prior), updated.ess),
            ancestors=ancestry.ancestors,
            acceptance=jnp.ones((), log_weights.dtype),
            divergences=jnp.zeros((), jnp.int32),
            num_likelihood=jnp.asarray(num_particles, jnp.int32),
            num_gradient=jnp.zeros((), jnp.int32),
            failed=updated.degenerate,
            step_size=jnp.full((), jnp.nan, log_weights.dtype),
        )
        return ParticleState(particles, log_weights), info

    def init(rng_key: jax.Array, observation: Observation, inputs: Any = None) -> tuple[ParticleState, Info]:
        particles = jax.vmap(lambda k: model.sample_initial(k, inputs))(particle_keys(rng_key, num_particles))
        uniform = jnp.full(num_particles, -jnp.log(num_particles), particles.dtype)
        return weigh(particles, Ancestry(adaptive.everyone(), uniform), observation, inputs)

    def step(
        rng_key: jax.Array, state: ParticleState, observation: Observation, inputs: Any = None
    ) -> tuple[ParticleState, Info]:
        key_resample, key_predict = jax.random.split(rng_key)
        uniform = jnp.full_like(state.log_weights, -jnp.log(num_particles))
        ancestry = adaptive.choose(key_resample, state.log_weights, uniform, state.log_weights)
        keys = particle_keys(key_predict, num_particles)
        previous = state.particles[ancestry.ancestors]
        particles = jax.vmap(lambda k, x: model.sample_transition(k, x, inputs))(keys, previous)
        return weigh(particles, ancestry, observation, inputs)

    return Filter(init, step, genealogy=True)
