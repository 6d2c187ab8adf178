"""A model's functions for a population of particles: those of one particle, vmapped.

States are (N, d), keys (N,) from :func:`poseppl.particles.keys.particle_keys` or `jax.random.split`; data and inputs are one
frame's, the same for all.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.program.compiled import CompiledModel
from poseppl.program.observation import Observation


def draw_initial(model: CompiledModel, keys: Array, inputs: Any) -> Array:
    """States (N, d) drawn from the initial program."""
    return jax.vmap(lambda key: model.sample_initial(key, inputs))(keys)


def propagate(model: CompiledModel, keys: Array, previous: Array, inputs: Any) -> Array:
    """States (N, d), each drawn from the transition of its own state before (N, d)."""
    return jax.vmap(lambda key, x: model.sample_transition(key, x, inputs))(keys, previous)


def differentiable_draws(model: CompiledModel, xs: Array, previous: Array | None, inputs: Any) -> tuple[Array, Array]:
    """States (N, d) as they were drawn, and log-weights (N,) of value 0 with the derivative that draws do not have."""
    if previous is None:
        return jax.vmap(lambda x: model.differentiable_draw(x, None, inputs))(xs)
    return jax.vmap(lambda x, before: model.differentiable_draw(x, before, inputs))(xs, previous)


def log_likelihoods(model: CompiledModel, xs: Array, observation: Observation, inputs: Any) -> Array:
    """Log-likelihoods (N,) of a frame's data."""
    return jax.vmap(lambda x: model.log_observation(x, observation, inputs))(xs)


def log_initials(model: CompiledModel, xs: Array, inputs: Any) -> Array:
    """Log-densities (N,) of first states."""
    return jax.vmap(lambda x: model.log_initial(x, inputs))(xs)


def log_transitions(model: CompiledModel, xs: Array, previous: Array, inputs: Any) -> Array:
    """Log-densities (N,) of states, each given its own state before (N, d)."""
    return jax.vmap(lambda x, before: model.log_transition(x, before, inputs))(xs, previous)


def log_transitions_into(model: CompiledModel, x: Array, previous: Array, inputs: Any) -> Array:
    """Log-densities (N,) of one state (d,) given each of the states before (N, d)."""
    return jax.vmap(lambda before: model.log_transition(x, before, inputs))(previous)


def log_transition_matrix(model: CompiledModel, xs: Array, previous: Array, inputs: Any) -> Array:
    """Log-densities log p(x_j | x_i) (M, N) of states (M, d) given each of those before (N, d)."""
    return jax.vmap(lambda x: log_transitions_into(model, x, previous, inputs))(xs)


def log_prediction(model: CompiledModel, x: Array, previous: Array, inputs: Any) -> Array:
    """Log-density of one state (d,) under the mixture of the transitions from equally weighted states before (N, d)."""
    return jax.nn.logsumexp(log_transitions_into(model, x, previous, inputs)) - jnp.log(previous.shape[0])


def transition_moments(model: CompiledModel, previous: Array, inputs: Any) -> tuple[Array, Array]:
    """Means (N, d) and covariances (N, d, d) of the next states, given each of those before (N, d)."""
    return jax.vmap(lambda x: model.transition_moments(x, inputs))(previous)
