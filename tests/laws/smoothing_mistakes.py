"""Mistakes that a smoother could make, wrapped around it: in what it is given, and in what it tells.

They are numbers that a compiled program takes, so that the right smoother and all wrong ones are one program. The filter before
it and the exact answer know nothing of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist

from poseppl.program import StateSpaceModel


class Given(NamedTuple):
    """Inputs of a model whose densities are raised to powers.

    Attributes:
        push: Inputs of the linear Gaussian model.
        prior: Power of the initial density, or of the transition's.
        data: Power of the observation's.
    """

    push: Any
    prior: Any
    data: Any


def powered(matrices):
    """A compiled linear Gaussian model of diagonal covariances whose densities are raised to the powers of its inputs."""
    initial, transition, noise = (np.sqrt(np.diagonal(P)) for P in (matrices.P, matrices.Q, matrices.R))

    def draw_state(mean, scale, given):
        numpyro.sample("x", dist.Normal(mean, scale / jnp.sqrt(given.prior)).to_event(1))

    def draw_data(mean, given):
        numpyro.sample("y", dist.Normal(mean, noise / jnp.sqrt(given.data)))

    return StateSpaceModel(
        lambda params, given: draw_state(matrices.m, initial, given),
        lambda params, state, given: draw_state(matrices.A @ state["x"] + matrices.B @ given.push, transition, given),
        lambda params, state, given: draw_data(matrices.H @ state["x"], given),
    ).compile(Given(np.zeros(matrices.B.shape[1]), 1.0, 1.0))


def misinformed(mistakes, model, history, observations, inputs):
    """Arguments of a smoother: `(history, observations, inputs)`."""
    log_weights = history.log_weights
    if isinstance(inputs, Given):
        last = jax.tree.map(lambda leaf: leaf[-1], (observations, inputs))
        seen = jax.vmap(lambda x: model.log_observation(x, *last))(history.particles[-1])
        log_weights = log_weights.at[-1].set(jax.nn.log_softmax(log_weights[-1] + mistakes.last * seen))
    log_weights = jnp.where(mistakes.flat, -jnp.log(log_weights.shape[1]), late(mistakes.late_data, log_weights))
    inputs = late(mistakes.late_inputs, inputs)
    if isinstance(inputs, Given):
        prior = (inputs.prior + mistakes.transition).at[0].set(1.0 + mistakes.initial)
        inputs = inputs._replace(prior=prior, data=inputs.data.at[-1].add(mistakes.last))
    return history._replace(log_weights=log_weights), late(mistakes.late_data, observations), inputs


def told(mistakes, particles, log_weights):
    """The states (T, N, d) and log-weights (T, N) that a smoother tells, of whatever chains they are."""
    particles = particles.reshape(len(particles), -1, particles.shape[-1])
    log_weights = jax.nn.log_softmax(log_weights.reshape(len(log_weights), -1))
    turned = mistakes.shuffled * jnp.arange(len(particles)) % 2 == 1
    particles = jnp.where(turned[:, None, None], particles[:, ::-1], particles)
    log_weights = jnp.where(turned[:, None], log_weights[:, ::-1], log_weights)
    return late(mistakes.late_states, (particles, log_weights))


def late(frames, tree):
    """Stacked arrays in which every frame has what stood so many frames before."""
    return jax.tree.map(lambda leaf: jnp.roll(leaf, frames, axis=0), tree)
