"""Data sets of the growth model with exact smoothed means, a filter's histories, and a hand-written smoother as yardstick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_models.growth import growth

from poseppl.filters import particle_filter
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers import History, Smoothed, Smoother, collect_history

VARIANCE = 10.0
"""Of the transition and of the first state."""

GRID = np.linspace(-45.0, 45.0, 1501)


class Growth(NamedTuple):
    """Data sets of d coordinates, each on its own.

    Attributes:
        model: The compiled model.
        times: Its inputs (T,).
        truth: States (S, T, d).
        observations: Stacked data (S, T, ...).
        filtered: Exact filtered means (S, T, d).
        smoothed: Exact smoothed means (S, T, d).
    """

    model: CompiledModel
    times: jax.Array
    truth: np.ndarray[Any, Any]
    observations: Observation
    filtered: np.ndarray[Any, Any]
    smoothed: np.ndarray[Any, Any]


def growth_sets(num_sets: int, num_frames: int = 100, dimension: int = 1, seed: int = 0) -> Growth:
    """Draw data sets and solve them on a grid, coordinate by coordinate."""
    rng = np.random.default_rng(seed)
    shape = (num_sets, dimension)
    xs = [rng.normal(size=shape) * VARIANCE**0.5]
    for t in range(2, num_frames + 1):
        xs.append(step_mean(xs[-1], t) + VARIANCE**0.5 * rng.normal(size=shape))
    truth = np.stack(xs, 1)
    ys = truth**2 / 20 + rng.normal(size=truth.shape)
    model = growth(dimension).compile(1.0)
    sets = [model.observe({"y": y[:, 0] if dimension == 1 else y}) for y in ys]
    observations = jax.tree.map(lambda *leaves: jnp.stack(leaves), *sets)
    series = ys.transpose(0, 2, 1).reshape(-1, num_frames)
    filtered, smoothed = (a.reshape(num_sets, dimension, num_frames).transpose(0, 2, 1) for a in exact_means(series))
    return Growth(model, jnp.arange(1.0, num_frames + 1), truth, observations, filtered, smoothed)


def step_mean(x: Any, time: int) -> Any:
    """Mean of x_t given x_(t-1)."""
    return x / 2 + 25 * x / (1 + x * x) + 8 * np.cos(1.2 * time)


def exact_means(ys: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Filtered and smoothed means (S, T) of scalar series ys (S, T), all at once on the grid."""
    num_frames = ys.shape[1]

    def likelihood(t: int) -> np.ndarray[Any, Any]:
        values: np.ndarray[Any, Any] = np.exp(-0.5 * (ys[:, t, None] - GRID**2 / 20) ** 2)
        return values

    def kernel(t: int) -> np.ndarray[Any, Any]:
        values: np.ndarray[Any, Any] = np.exp(-0.5 / VARIANCE * (GRID - step_mean(GRID, t + 1)[:, None]) ** 2)
        return values

    forward: list[np.ndarray[Any, Any]] = []
    for t in range(num_frames):
        predicted = np.exp(-0.5 / VARIANCE * GRID**2) if t == 0 else forward[-1] @ kernel(t)
        joint = predicted * likelihood(t)
        forward.append(joint / joint.sum(1, keepdims=True))
    backward, means = np.ones_like(forward[0]), [forward[-1] @ GRID]
    for t in range(num_frames - 1, 0, -1):
        backward = (backward * likelihood(t)) @ kernel(t).T
        backward /= backward.max(1, keepdims=True)
        product = forward[t - 1] * backward
        means.append(product @ GRID / product.sum(1))
    return np.stack([p @ GRID for p in forward], 1), np.stack(means[::-1], 1)


def filter_history(
    model: CompiledModel, num_particles: int, rng_key: jax.Array, observations: Observation, times: jax.Array
) -> History:
    """The history of a bootstrap filter over all frames."""
    tracker = particle_filter(model, num_particles)
    first, later = (jax.tree.map(lambda leaf, rows=rows: leaf[rows], (observations, times)) for rows in (0, slice(1, None)))
    key_init, key_steps = jax.random.split(rng_key)
    state, info = tracker.init(key_init, *first)

    def step(state: Any, row: Any) -> tuple[Any, History]:
        state, info = tracker.step(row[0], state, *row[1])
        return state, collect_history(row[0], state, info, None)

    begun = collect_history(key_init, state, info, None)
    _, rest = jax.lax.scan(step, state, (jax.random.split(key_steps, times.shape[0] - 1), later))
    history: History = jax.tree.map(lambda one, many: jnp.concatenate([one[None], many]), begun, rest)
    return history


def means_of(result: History | Smoothed) -> jax.Array:
    """Weighted means (T, d)."""
    weights = jax.nn.softmax(jax.lax.optimization_barrier(result.log_weights), 1)  # or constants are folded at length
    return jnp.einsum("tn,tnd->td", weights, result.particles)


Run = Callable[[jax.Array, Observation], tuple[jax.Array, jax.Array]]


def run_of(posed: Growth, num_particles: int, build: Callable[[CompiledModel, int], Smoother] | None) -> Run:
    """`(rng_key, observations) -> filtered and smoothed means (T, d)`, jitted; without a smoother the filter's twice."""
    smoother = None if build is None else build(posed.model, num_particles)

    @jax.jit
    def run(rng_key: jax.Array, observations: Observation) -> tuple[jax.Array, jax.Array]:
        key_filter, key_smooth = jax.random.split(rng_key)
        history = filter_history(posed.model, num_particles, key_filter, observations, posed.times)
        filtered = means_of(history)
        if smoother is None:
            return filtered, filtered
        return filtered, means_of(smoother.smooth(key_smooth, history, observations, posed.times))

    return run


def hand_written(tile: int = 100) -> Smoother:
    """Forward-backward reweighting of the one-dimensional growth model, written for nothing else: the yardstick of speed."""

    def smooth(rng_key: Any, history: History, observations: Observation, inputs: jax.Array) -> Smoothed:
        xs, weights = history.particles[..., 0], jnp.exp(history.log_weights)
        count = xs.shape[1]
        missing = -count % tile

        def tiles(row: jax.Array) -> jax.Array:
            return jnp.pad(row, (0, missing)).reshape(-1, tile)

        def back(smoothed: jax.Array, frame: Any) -> tuple[jax.Array, jax.Array]:
            x, w, later, time = frame
            centre = x / 2 + 25 * x / (1 + x * x) + 8 * jnp.cos(1.2 * time)

            def part(total: jax.Array, rows: Any) -> tuple[jax.Array, None]:
                densities = jnp.exp(-0.05 * (rows[0][:, None] - centre) ** 2)
                return total + (rows[1] / jnp.maximum(densities @ w, 1e-37)) @ densities, None

            total, _ = jax.lax.scan(part, jnp.zeros_like(w), (tiles(later), tiles(smoothed)))
            return w * total, w * total

        _, rest = jax.lax.scan(back, weights[-1], (xs[:-1], weights[:-1], xs[1:], inputs[1:]), reverse=True)
        smoothed = jnp.concatenate([rest, weights[-1:]])
        return Smoothed(history.particles, jnp.log(smoothed), None)  # type: ignore[arg-type]

    return Smoother(smooth, joint=False)
