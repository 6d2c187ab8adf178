"""The problems that the laws pose to every smoother, and how they run it behind a particle filter."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from catalogue import MOMENTS
from law_problems import INFINITE_SQUARE, NUM_FRAMES, TWO_STATES, Problem, frame, moments, problem, run
from mistakes import NO_MISTAKES
from oracles.forward_backward import forward_backward
from oracles.grid import growth_on_grid
from oracles.kalman import fixed_lag_moments, kalman_filter, lag_one_covariances, rauch_tung_striebel, simulate
from poseppl_models.toys.finite_hmm import finite_hmm
from poseppl_models.toys.growth import growth
from poseppl_models.toys.linear_gaussian import linear_gaussian_matrices, linear_gaussian_model
from smoothing_mistakes import Given, misinformed, powered, told

from poseppl.filters import particle_filter
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers import History, collect_history


class Smoothing(NamedTuple):
    """A problem with known answer.

    Attributes:
        model: The compiled model.
        observations: Stacked data (T,).
        inputs: Stacked inputs, or None.
        means: Exact smoothed means (T, d).
        covariances: Exact smoothed covariances (T, d, d).
        pairs: Exact smoothed covariances (T - 1, d, d) of each frame's state and the next one's, where they are known.
    """

    model: CompiledModel
    observations: Observation
    inputs: Any
    means: np.ndarray
    covariances: np.ndarray
    pairs: np.ndarray | None = None


def linear_problem() -> Smoothing:
    """The problem of the filters' laws."""
    posed: Problem = problem()
    exact = rauch_tung_striebel(posed.matrices, posed.exact)
    return Smoothing(posed.model, posed.observations, posed.inputs, *exact)


def linear_problem_with_powers(lag: int | None = None) -> Smoothing:
    """The same, its densities raised to powers that are inputs; given a lag, frames know the data of no more later ones."""
    posed, ones = problem(), jnp.ones(NUM_FRAMES)
    if lag is None:
        exact = *rauch_tung_striebel(posed.matrices, posed.exact), lag_one_covariances(posed.matrices, posed.exact)
    else:
        exact = fixed_lag_moments(posed.matrices, posed.exact, lag)
    return Smoothing(powered(posed.matrices), posed.observations, Given(posed.inputs, ones, ones), *exact)


def linear_problem_of_dimension(dimension: int) -> Smoothing:
    """A damped chain of coordinates, of which at most two are seen, so that a small particle filter can follow."""
    matrices = linear_gaussian_matrices(dimension, min(dimension, 2))
    _, ys = simulate(matrices, 4, seed=dimension)
    model = linear_gaussian_model(matrices).compile()
    exact = rauch_tung_striebel(matrices, kalman_filter(matrices, ys))
    return Smoothing(model, model.observe({"y": ys}), None, *exact)


def chain_problem(dimension: int, num_frames: int) -> Problem:
    """A damped chain of coordinates, of which two are seen behind as much noise as they have spread."""
    matrices = linear_gaussian_matrices(dimension, 2, Q=0.5 * np.eye(dimension), R=np.eye(2))
    _, ys = simulate(matrices, num_frames, seed=dimension)
    model = linear_gaussian_model(matrices).compile()
    return Problem(matrices, model, model.observe({"y": ys}), jnp.zeros(num_frames), kalman_filter(matrices, ys))


def smoothed_chain(dimension: int, num_frames: int) -> Smoothing:
    """The same for smoothers."""
    posed = chain_problem(dimension, num_frames)
    exact = rauch_tung_striebel(posed.matrices, posed.exact)
    return Smoothing(posed.model, posed.observations, None, *exact, lag_one_covariances(posed.matrices, posed.exact))


def markov_problem(num_states: int) -> Smoothing:
    """A hidden Markov chain of sticky states, each with one of four symbols; a symbol in the middle is missing."""
    if num_states == 2:
        initial, transition, emission = TWO_STATES
    else:
        rng = np.random.default_rng(num_states)
        initial, transition, emission = (rng.dirichlet(np.ones(k), n) for n, k in ((1, 5), (5, 5), (5, 4)))
        initial, transition = initial[0], 0.5 * transition + 0.5 * np.eye(5)
    ys = np.array([0, 1, 2, -1, 0, 2])
    model = finite_hmm(initial, transition, emission).compile()
    probabilities = forward_backward(initial, transition, emission, ys)[1]
    states = np.arange(len(initial))
    means = probabilities @ states
    variances = ((states - means[:, None]) ** 2 * probabilities).sum(1)
    values = np.where(ys < 0, np.nan, ys)
    return Smoothing(model, model.observe({"y": values}), None, means[:, None], variances[:, None, None])


def growth_problem() -> Smoothing:
    """Six frames of the growth model, one of them missing, solved by quadrature."""
    ys = np.array([1.2, 4.0, np.nan, 9.0, 2.0, 0.5])
    model = growth().compile(1.0)
    grid, _, smoothed, _ = growth_on_grid(ys)
    means = smoothed @ grid
    variances = (smoothed * (grid - means[:, None]) ** 2).sum(1)
    return Smoothing(model, model.observe({"y": ys}), jnp.arange(1.0, 7.0), means[:, None], variances[:, None, None])


def filtered_history(rng_key, posed, num_particles):
    """Record of a particle filter: `History` of all frames, with its data as the driver passes them to a smoother."""
    filter_ = particle_filter(posed.model, num_particles)
    num_frames = posed.means.shape[0]
    inputs = jnp.zeros(num_frames) if posed.inputs is None else posed.inputs
    states, infos = run(filter_, rng_key, posed.observations, inputs)
    history = jax.vmap(lambda state, info: collect_history(None, state, info, None))(states, infos)
    return history, without_failed(posed.model, posed.observations, history.failed)


def without_failed(model, observations, failed):
    """Take away the data of failed frames."""
    nothing = model.unobserved()
    hide = jax.vmap(lambda seen, failed: jax.tree.map(lambda a, b: jnp.where(failed, a, b), nothing, seen))
    return hide(observations, failed)


@cache
def replicator(row, posed_by, *arguments):
    """A problem, and a function that runs filter and smoother again and again, compiled once for right and wrong variants."""
    posed = posed_by(*arguments)
    smoother, centres = row.build(posed.model), jnp.asarray(posed.means)

    def one(rng_key, mistakes):
        key_filter, key_smooth = jax.random.split(rng_key)
        history, observations = filtered_history(key_filter, posed, row.num_particles)
        given = misinformed(mistakes, posed.model, history, observations, posed.inputs)
        data, same = jax.random.key_data(key_smooth), jax.random.key_data(jax.random.key(0))
        smoothed = smoother.smooth(jax.random.wrap_key_data(jnp.where(mistakes.one_key, same, data)), *given)
        states = told(mistakes, smoothed.particles, smoothed.log_weights)
        right, filtered = pair_moments(*states, centres), pair_moments(*history[:2], centres)
        return jax.tree.map(lambda a, b: jnp.where(mistakes.filtered, b, a), right, filtered)

    run_all = jax.jit(lambda keys, mistakes: jax.lax.map(lambda key: one(key, mistakes), keys))

    def replicate(mistakes=NO_MISTAKES):
        """Means (K, T, d), second moments about the exact means (K, T, d, d), and those of neighbours (K, T - 1, d, d)."""
        keys = jax.random.split(jax.random.key(1), row.num_replicates)
        return tuple(np.asarray(a, float) for a in run_all(keys, mistakes))

    return posed, replicate


def pair_moments(particles, log_weights, centres):
    """Means (T, d), second moments about centres (T, d, d), and those of each frame with the next, index by index."""
    means, seconds = moments(History(particles, log_weights, None, None), centres)
    centred = particles - centres[:, None]
    return means, seconds, jnp.einsum("tn,tni,tnj->tij", jnp.exp(log_weights[:-1]), centred[:-1], centred[1:])


def broken_laws(row, posed, found):
    """The moments of replicated runs that are not the exact ones, of those that a smoother of this row knows."""
    exact = dict(zip(MOMENTS, (posed.means, posed.covariances, posed.pairs), strict=True))
    if posed.pairs is None or not row.build(posed.model).joint:
        del exact["neighbours"]
    samples = dict(zip(MOMENTS, found, strict=True))
    return {name for name, truth in exact.items() if name in row.moments and not is_mean(samples[name], truth)}


def is_mean(samples, truth):
    """Whether means over the first axis are the truth, within five standard errors."""
    errors = samples.std(0, ddof=1) / np.sqrt(len(samples))
    return bool((np.abs(samples.mean(0) - truth) < 5 * errors).all())


@cache
def history_for_conduct(num_particles=20, num_frames=5, impossible=None):
    """A small history of the linear problem: `(history, observations, inputs)`, with impossible data at a frame if asked."""
    posed = linear_problem()
    values = posed.observations.values["y"]
    if impossible is not None:
        values = values.at[impossible].set(INFINITE_SQUARE)
    observations = posed.observations._replace(values={"y": values})
    few = slice(0, num_frames)
    history, observations = filter_for_conduct(num_particles, num_frames)(jax.random.key(3), frame(observations, few))
    return history, observations, posed.inputs[few]


@cache
def filter_for_conduct(num_particles, num_frames):
    """The jitted filter behind `history_for_conduct`."""
    posed = linear_problem()
    posed = posed._replace(inputs=posed.inputs[:num_frames], means=posed.means[:num_frames])
    return jax.jit(lambda key, observations: filtered_history(key, posed._replace(observations=observations), num_particles))


@cache
def smoother_for_conduct(row):
    """The jitted smoother of a row for the linear problem, and a list that grows by one whenever it is traced."""
    built = row.build(linear_problem().model)
    traces: list[int] = []

    def smooth(*arguments):
        traces.append(1)
        return built.smooth(*arguments)

    return jax.jit(smooth), traces
