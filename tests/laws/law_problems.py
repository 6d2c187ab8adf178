"""The problem that the laws pose to every filter, and how they run it."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from mistakes import NO_MISTAKES, mistaken
from oracles.kalman import KalmanResult, kalman_filter, simulate
from poseppl_models.toys.linear_gaussian import LinearGaussian, linear_gaussian_matrices, linear_gaussian_model

from poseppl.program import CompiledModel, Observation

NUM_FRAMES = 5
MASKED = 2
INFINITE_SQUARE = 1e30 if jnp.result_type(float) == jnp.float32 else 1e200
"""A datum that nothing explains."""
"""The frame without data."""
TWO_STATES = ([0.6, 0.4], [[0.9, 0.1], [0.2, 0.8]], [[0.7, 0.2, 0.1], [0.1, 0.3, 0.6]])
"""A hidden Markov chain: how it starts, moves and is seen."""


class Problem(NamedTuple):
    matrices: LinearGaussian
    model: CompiledModel
    observations: Observation  # stacked, (T,)
    inputs: jax.Array  # (T, 1)
    exact: KalmanResult

    def at(self, t):
        """Observation and inputs of a frame."""
        return frame((self.observations, self.inputs), t)


def problem() -> Problem:
    """A linear Gaussian model in two dimensions with time-varying inputs, one frame missing and one entry of another."""
    matrices = linear_gaussian_matrices(2, A=[[0.9, 0.2], [-0.1, 0.8]], H=[[1.0, 0.0], [1.0, 1.0]], B=[[1.0], [0.5]])
    inputs = np.linspace(1.0, -2.0, NUM_FRAMES)[:, None]
    _, ys = simulate(matrices, NUM_FRAMES, seed=11, inputs=inputs)
    mask = np.ones(ys.shape, bool)
    mask[MASKED] = False
    mask[-1, 1] = False
    model = linear_gaussian_model(matrices).compile(inputs[0])
    observations = model.observe({"y": np.where(mask, ys, np.nan)})
    exact = kalman_filter(matrices, ys, mask, inputs)
    return Problem(matrices, model, observations, jnp.asarray(inputs), exact)


class Compiled(NamedTuple):
    """A filter's jitted functions, and a list that grows by one whenever `step` is traced."""

    init: Any
    step: Any
    traces: list[int]


@cache
def compiled(row) -> Compiled:
    """The filter of a row for the problem, compiled once for all laws."""
    built = row.build(problem().model)
    traces: list[int] = []

    def step(*arguments):
        traces.append(1)
        return built.step(*arguments)

    return Compiled(jax.jit(built.init), jax.jit(step), traces)


def go_through(row, observations, inputs):
    """States and infos, frame by frame."""
    functions = compiled(row)
    keys = jax.random.split(jax.random.key(0), inputs.shape[0])
    frames = [functions.init(keys[0], frame(observations, 0), frame(inputs, 0))]
    for t in range(1, inputs.shape[0]):
        frames.append(functions.step(keys[t], frames[-1][0], frame(observations, t), frame(inputs, t)))
    return frames


def frame(tree, t):
    """One frame of stacked data."""
    return jax.tree.map(lambda a: a[t], tree)


def run(filter_, rng_key, observations, inputs):
    """States and infos of all frames: step after step in a scan."""
    key_init, key_steps = jax.random.split(rng_key)
    state, info = filter_.init(key_init, frame(observations, 0), frame(inputs, 0))
    later = jax.tree.map(lambda a: a[1:], (observations, inputs))
    keys = jax.random.split(key_steps, len(jax.tree.leaves(observations)[0]) - 1)

    def advance(state, item):
        state, info = filter_.step(item[0], state, *item[1])
        return state, (state, info)

    _, rest = jax.lax.scan(advance, state, (keys, later))
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), (state, info), rest)


def moments(states, centres):
    """Weighted means (T, d), and second moments (T, d, d) about given centres (T, d), of stacked states."""

    def one(state, centre):
        particles = state.particles.reshape(-1, state.particles.shape[-1])
        weights = jax.nn.softmax(state.log_weights.reshape(-1))
        centred = particles - centre
        return weights @ particles, (centred * weights[:, None]).T @ centred

    return jax.vmap(one)(states, centres)


def independent(one, number, seed=0):
    """Values of ``one`` for this number of keys, in one program."""
    return jax.jit(lambda keys: jax.lax.map(one, keys))(jax.random.split(jax.random.key(seed), number))


BATCH = 40
"""Runs that a program makes; their multiples need no other one."""


def replicate(filter_, posed, num_replicates, centres=None, seed=0, mistakes=NO_MISTAKES):
    """Means (K, T, d), second moments about the centres (K, T, d, d) and evidence increments (K, T) of independent runs.

    The centres are the exact filtered means unless given; about them, second moments are free of a run's error in the mean.
    """
    centres = jnp.asarray(posed.exact.means if centres is None else centres)
    size = num_replicates if num_replicates % BATCH else BATCH
    keys = jax.random.split(jax.random.key(seed), num_replicates).reshape(-1, size)
    batches = [runs_of(filter_, posed.model)(each, mistakes, posed.observations, posed.inputs, centres) for each in keys]
    return tuple(np.concatenate(parts).astype(float) for parts in zip(*batches, strict=True))


@cache
def runs_of(filter_, model):
    """The jitted function behind `replicate`, one for each filter: other data of the same shape need no compilation."""

    def one(rng_key, mistakes, observations, inputs, centres):
        inputs = jax.tree.map(lambda leaf: jnp.roll(leaf, mistakes.late_inputs, axis=0), inputs)
        states, infos = run(mistaken(filter_, model, mistakes), rng_key, observations, inputs)
        shifted = jax.tree.map(lambda leaf: jnp.roll(leaf, mistakes.late_states, axis=0), states)
        return *moments(shifted, centres), jnp.roll(infos.log_evidence, mistakes.late_evidence)

    return jax.jit(lambda keys, *posed: jax.lax.map(lambda key: one(key, *posed), keys))


def z_scores(samples, exact):
    """(mean - exact) in Monte Carlo standard errors, over the first axis of replicates."""
    return (samples.mean(0) - exact) / (samples.std(0, ddof=1) / np.sqrt(len(samples)))


def check_impossible(filter_, posed, num_replicates):
    """Nothing explains the second frame; what comes after is Kalman's without the data of that frame."""
    mask = np.array(posed.observations.mask["y"])
    mask[1] = False
    exact = kalman_filter(posed.matrices, posed.observations.values["y"], mask, np.asarray(posed.inputs))
    values = posed.observations.values["y"].at[1].set(INFINITE_SQUARE)
    impossible = posed._replace(observations=posed.observations._replace(values={"y": values}), exact=exact)
    means, seconds, increments = replicate(filter_, impossible, num_replicates)
    assert (increments[:, 1] == -np.inf).all()
    assert np.abs(z_scores(means, exact.means)).max() < 5
    assert np.abs(z_scores(seconds, exact.covariances)).max() < 5
