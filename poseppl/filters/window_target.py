r"""The joint density of the frames in a moving window, and its curvature.

    N(x_s; m_s, P_s) p(z_s | x_s) prod over u = s + 1 .. t of p(x_u | x_(u-1)) p(z_u | x_u),

where N(m_s, P_s) stands for p(x_s | z_0 .. z_(s-1)). While the first frame of the sequence is in the window, s is 0 and the
summary is the initial program itself. The slots before it have no frame yet; they are independent and N(m_0, P_0), so that the
window has W slots from the start.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.filters.chains import LogDensity
from poseppl.gaussians.block_tridiagonal import BlockTridiagonal, to_dense
from poseppl.gaussians.gaussian import Gaussian, precision_of
from poseppl.gaussians.linear_transitions import transition_around, transition_curvature
from poseppl.gaussians.mixture import GaussianMixture, log_mixture
from poseppl.program import CompiledModel, Observation
from poseppl.program.population import log_initials


class Window(NamedTuple):
    """The W frames in a window, the newest last.

    Attributes:
        predictions: Prediction of each frame, given the data of the frames before it: means (W, d) and covariances (W, d, d).
        observations: Data with a leading W; nothing is observed in slots without a frame.
        inputs: Inputs with a leading W, or None.
        num_frames: How many frames there have been, at most W + 1, int32.
    """

    predictions: Gaussian
    observations: Observation
    inputs: Any
    num_frames: Array


class WindowTarget(NamedTuple):
    """Functions of the window's states as one vector (W d,).

    Attributes:
        log_density: The joint log-density, a scalar.
        information: The curvature (W d, W d) of data and transitions.
        prior_precision: The curvature (W d, W d) of the summary.
    """

    log_density: LogDensity
    information: Callable[[Array], Array]
    prior_precision: Array


def empty_window(model: CompiledModel, size: int, inputs: Any) -> Window:
    """A window of W slots without a frame; every slot has the first frame's inputs and its initial moments."""

    def repeat(leaf: Any) -> Array:
        array = jnp.asarray(leaf)
        return jnp.broadcast_to(array, (size, *array.shape))

    moments = Gaussian(*model.initial_moments(inputs))
    predictions, observations, inputs = jax.tree.map(repeat, (moments, model.unobserved(), inputs))
    return Window(predictions, observations, inputs, jnp.zeros((), jnp.int32))


def move_on(window: Window, prediction: Gaussian, observation: Observation, inputs: Any) -> Window:
    """The window one frame later: the oldest slot is forgotten, and the new frame takes the last one."""
    size = window.predictions.mean.shape[0]
    old, new = (window.predictions, window.observations, window.inputs), (prediction, observation, inputs)
    moved: tuple[Gaussian, Observation, Any] = jax.tree.map(
        lambda many, one: jnp.concatenate([many[1:], jnp.asarray(one)[None]]), old, new
    )
    predictions, observations, inputs = moved
    return Window(predictions, observations, inputs, jnp.minimum(window.num_frames + 1, size + 1))


def window_target(model: CompiledModel, window: Window) -> WindowTarget:
    """The target of a window with at least one frame."""
    size, dimension = window.predictions.mean.shape
    first = jnp.maximum(size - window.num_frames, 0)
    slot = jnp.arange(size)
    alone, follows = slot <= first, slot[1:] > first
    summaries = [_log_normal(window.predictions.mean[u], window.predictions.covariance[u]) for u in range(size)]
    later = jax.tree.map(lambda leaf: leaf[1:], window.inputs)
    begin = jax.tree.map(lambda leaf: leaf[0], window.inputs)
    # with W + 1 frames behind it the window has left the first one
    started = (slot == first) & (window.num_frames <= size)

    def log_density(flat: Array) -> Array:
        xs = flat.reshape(size, dimension)
        summary = jnp.stack([log_normal(x) for log_normal, x in zip(summaries, xs, strict=True)])
        initial = log_initials(model, xs, begin)
        total = jnp.sum(jnp.where(started, initial, jnp.where(alone, summary, 0.0)))
        moves = jax.vmap(model.log_transition)(xs[1:], xs[:-1], later)
        data = jax.vmap(model.log_observation)(xs, window.observations, window.inputs)
        return total + jnp.sum(jnp.where(follows, moves, 0.0)) + jnp.sum(data)

    def information(flat: Array) -> Array:
        xs = flat.reshape(size, dimension)
        data = jax.vmap(model.observation_information)(xs, window.observations, window.inputs)
        blocks = jax.vmap(transition_curvature)(*jax.vmap(partial(transition_around, model))(xs[:-1], later)[1:])
        before, below, after = (jnp.where(follows[:, None, None], block, 0.0) for block in blocks)
        return to_dense(BlockTridiagonal(data.at[:-1].add(before).at[1:].add(after), below))

    precisions = jnp.where(alone[:, None, None], jax.vmap(precision_of)(window.predictions.covariance), 0.0)
    return WindowTarget(log_density, information, to_dense(BlockTridiagonal(precisions, jnp.zeros_like(precisions[1:]))))


def _log_normal(mean: Array, covariance: Array) -> LogDensity:
    return log_mixture(GaussianMixture(jnp.zeros(1, mean.dtype), mean[None], covariance[None]))
