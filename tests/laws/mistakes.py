"""Mistakes that a filter could make, wrapped around it: the laws have to notice each of them, whatever the filter.

They are numbers that a compiled program takes, so that the right filter and all wrong ones are one program.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp


class Mistakes(NamedTuple):
    """What goes wrong; 0 is right.

    Attributes:
        late_inputs: Every frame has the inputs of so many frames before.
        late_evidence: Every frame has the evidence of so many frames before.
        late_states: Every frame has the states of so many frames before; those go on as they should.
        flat: 1 forgets the weights, in what is told and in the next step.
        data: How many more times the data of a frame count.
        initial: How many more times the initial density counts.
        one_key: 1 gives every step of every run the same key.
    """

    late_inputs: Any = 0
    late_evidence: Any = 0
    late_states: Any = 0
    flat: Any = 0.0
    data: Any = 0.0
    initial: Any = 0.0
    one_key: Any = 0


NO_MISTAKES = Mistakes()


def mistaken(filter_, model, mistakes):
    """The filter that makes the mistakes of its own: all but those of frames that are mixed up."""

    def init(rng_key, observation, inputs):
        state, info = filter_.init(rng_key, observation, inputs)
        state = weighed_again(state, mistakes.initial, lambda x: model.log_initial(x, inputs))
        return reweigh(state, observation, inputs), info

    def step(rng_key, state, observation, inputs):
        data, same = jax.random.key_data(rng_key), jax.random.key_data(jax.random.key(0))
        rng_key = jax.random.wrap_key_data(jnp.where(mistakes.one_key, same, data))
        state, info = filter_.step(rng_key, state, observation, inputs)
        return reweigh(state, observation, inputs), info

    def reweigh(state, observation, inputs):
        state = weighed_again(state, mistakes.data, lambda x: model.log_observation(x, observation, inputs))
        equal = jax.nn.logsumexp(state.log_weights) - jnp.log(state.log_weights.size)
        return state._replace(log_weights=jnp.where(mistakes.flat != 0, equal, state.log_weights))

    return dataclasses.replace(filter_, init=init, step=step)


def weighed_again(state, power, log_density):
    """A state whose particles are weighed by a power of a density; their sum stays."""
    values = jax.vmap(log_density)(state.particles.reshape(-1, state.particles.shape[-1])).reshape(state.log_weights.shape)
    weighed = state.log_weights + power * values
    weighed = weighed + jax.nn.logsumexp(state.log_weights) - jax.nn.logsumexp(weighed)
    return state._replace(log_weights=jnp.where(power != 0, weighed, state.log_weights))
