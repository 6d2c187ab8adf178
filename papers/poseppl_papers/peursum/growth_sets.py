"""Data sets of the growth model with exact means, and runs of a filter and a smoother on them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import particle_filter
from poseppl.filters.scan import scan_filter
from poseppl.motion.bodies.body import load_builder
from poseppl.program import CompiledModel, Observation
from poseppl.smoothers import History, Smoothed, Smoother, collect_history

VARIANCE = 10.0
"""Variance of the transition and of the first state."""

GRID = np.linspace(-45.0, 45.0, 1501)


class Growth(NamedTuple):
    """Data sets of d coordinates, each on its own.

    Attributes:
        model: The compiled model.
        times: Its inputs (T,).
        truth: States (S, T, d).
        observations: Stacked data (S, T, ...).
        values: The data as numbers (S, T, d).
    """

    model: CompiledModel
    times: Array
    truth: Floats
    observations: Observation
    values: Floats

    def exact(self) -> tuple[Floats, Floats]:
        """Exact filtered and smoothed means (S, T, d), from a grid, coordinate by coordinate."""
        sets, frames, dimension = self.values.shape
        series = self.values.transpose(0, 2, 1).reshape(-1, frames)
        filtered, smoothed = (means.reshape(sets, dimension, frames).transpose(0, 2, 1) for means in exact_means(series))
        return filtered, smoothed


def growth_sets(num_sets: int, num_frames: int = 100, dimension: int = 1, seed: int = 0) -> Growth:
    """Draw data sets."""
    rng = np.random.default_rng(seed)
    shape = (num_sets, dimension)
    xs = [rng.normal(size=shape) * VARIANCE**0.5]
    for t in range(2, num_frames + 1):
        xs.append(step_mean(xs[-1], t) + VARIANCE**0.5 * rng.normal(size=shape))
    truth = np.stack(xs, 1)
    ys = truth**2 / 20 + rng.normal(size=truth.shape)
    build: Any = load_builder("poseppl_models.toys.growth:growth")
    model = build(dimension).compile(1.0)
    sets = [model.observe({"y": y[:, 0] if dimension == 1 else y}) for y in ys]
    observations = jax.tree.map(lambda *leaves: jnp.stack(leaves), *sets)
    return Growth(model, jnp.arange(1.0, num_frames + 1), truth, observations, ys)


def step_mean(x: Any, time: int) -> Any:
    """Mean of x_t given x_(t-1)."""
    return x / 2 + 25 * x / (1 + x * x) + 8 * np.cos(1.2 * time)


def exact_means(ys: Floats) -> tuple[Floats, Floats]:
    """Filtered and smoothed means (S, T) of scalar series ys (S, T), all at once on the grid."""
    num_frames = ys.shape[1]

    def likelihood(t: int) -> Floats:
        return np.exp(-0.5 * (ys[:, t, None] - GRID**2 / 20) ** 2)

    def kernel(t: int) -> Floats:
        values: Floats = np.exp(-0.5 / VARIANCE * (GRID - step_mean(GRID, t + 1)[:, None]) ** 2)
        return values

    forward: list[Floats] = []
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
    model: CompiledModel, num_particles: int, rng_key: Array, observations: Observation, times: Array
) -> History:
    """The history of a bootstrap filter over all frames."""
    tracker = particle_filter(model, num_particles)
    history: History = scan_filter(tracker, rng_key, observations, times, collect=collect_history).outputs
    return history


def means_of(result: History | Smoothed) -> Array:
    """Weighted means (T, d)."""
    barrier: Any = jax.lax.optimization_barrier  # or constants are folded at length
    weights = jax.nn.softmax(barrier(result.log_weights), 1)
    return jnp.einsum("tn,tnd->td", weights, result.particles)


Run = Callable[[Array, Observation], tuple[Array, Array]]


def run_of(posed: Growth, num_particles: int, build: Callable[[CompiledModel, int], Smoother] | None) -> Run:
    """`(rng_key, observations) -> filtered and smoothed means (T, d)`, jitted; without a smoother the filter's twice."""
    smoother = None if build is None else build(posed.model, num_particles)

    @jit
    def run(rng_key: Array, observations: Observation) -> tuple[Array, Array]:
        key_filter, key_smooth = jax.random.split(rng_key)
        history = filter_history(posed.model, num_particles, key_filter, observations, posed.times)
        filtered = means_of(history)
        if smoother is None:
            return filtered, filtered
        return filtered, means_of(smoother.smooth(key_smooth, history, observations, posed.times))

    return run
