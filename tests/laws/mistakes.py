"""Mistakes that a filter could make, wrapped around it: the laws have to notice each of them, whatever the filter.

They are numbers that a compiled program takes, so that the right filter and all wrong ones are one program.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp


class Mistakes(NamedTuple):
    """Mistakes of a filter or of a smoother; 0 is right.

    Attributes:
        late_data: Every frame has the data, and the filter's weights, of so many frames before.
        late_inputs: Every frame has the inputs of so many frames before.
        late_evidence: Every frame has the evidence of so many frames before.
        late_states: Every frame reports the states of this number of frames before; the filter itself continues correctly.
        flat: 1 forgets the filter's weights, in the output and in the next step.
        filtered: 1 tells the filter's particles and weights as smoothed ones.
        data: How many more times the data of a frame count.
        initial: How many more times the initial density counts.
        transition: How many more times the transitions' densities count.
        last: How many more times the data of the last frame count.
        one_key: 1 gives every step of every run the same key.
        shuffled: 1 tells every other frame's draws in the reverse order, so that neighbours have nothing to do with each other.
    """

    late_data: Any = 0
    late_inputs: Any = 0
    late_evidence: Any = 0
    late_states: Any = 0
    flat: Any = 0
    filtered: Any = 0
    data: Any = 0.0
    initial: Any = 0.0
    transition: Any = 0.0
    last: Any = 0.0
    one_key: Any = 0
    shuffled: Any = 0


NO_MISTAKES = Mistakes()
SHARED_MISTAKES = {
    "inputs of the frame before": Mistakes(late_inputs=1),
    "states of the frame before": Mistakes(late_states=1),
    "weights ignored": Mistakes(flat=1),
    "initial density twice": Mistakes(initial=1.0),
    "one key for all": Mistakes(one_key=1),
}
"""Those that filters and smoothers could both make."""


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
