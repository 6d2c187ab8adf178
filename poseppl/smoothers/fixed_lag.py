r"""Fixed-lag smoothing (Kitagawa 1996, doi:10.2307/1390750): what frame t looks like once L more frames have been seen.

p(x_t | z_0..t+L) is approximated by the ancestors at frame t of the particles of frame t + L, with those particles' weights.
Data beyond the lag L are ignored (a bias that falls with L), and in exchange few lines have merged (a variance
that grows with L): Olsson, Cappe, Douc and Moulines 2008 (doi:10.3150/07-BEJ6150) weigh the two.

Online, `fixed_lag` wraps a filter of particles so that its state carries the last L + 1 frames, gathered by the ancestors of
each step; afterwards, `fixed_lag_smoother` reads the same from a history.

Example:
    tracker = fixed_lag(particle_filter(model, 1000), lag=5)
    state, info = tracker.step(rng_key, state, observation, inputs)
    weighted_mean(state.window[0], state.log_weights)        # frame t - 5
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least
from poseppl.filters.base import Filter, FilterInfo
from poseppl.particles.weights import normalise
from poseppl.program import CompiledModel, Observation
from poseppl.program.memoized_builder import memoized_builder
from poseppl.smoothers.base import History, Smoothed, Smoother, smoothing_info
from poseppl.smoothers.genealogy import check_genealogy, shared_ess


class FixedLagState(NamedTuple):
    """A filter's state with the window behind it.

    Attributes:
        inner: The filter's own state.
        window: Flat states (L + 1, N, d) of the last L + 1 frames, oldest first: entry [k, i] is the ancestor of particle i
            in frame t - L + k. Before frame 0 there is frame 0.
    """

    inner: Any
    window: Array

    @property
    def particles(self) -> Array:
        """The particles (N, d) of the newest frame."""
        current: Array = self.inner.particles
        return current

    @property
    def log_weights(self) -> Array:
        """Log-weights (N,), for the newest frame and for the window alike."""
        current: Array = self.inner.log_weights
        return current


@memoized_builder
def fixed_lag(filter: Filter, lag: int) -> Filter:
    """Make a filter of particles smooth as it goes.

    Args:
        filter: A filter whose `FilterInfo.ancestors` has one entry for each particle; others raise a ValueError at their first
            step.
        lag: L, the number of later frames that a frame waits for, at least 0.

    Returns:
        A filter whose state is :class:`FixedLagState`.

    Raises:
        ValueError: A negative lag.
    """
    check_at_least(0, lag=lag)

    def init(rng_key: Array, observation: Observation, inputs: Any = None) -> tuple[FixedLagState, FilterInfo]:
        inner, info = filter.init(rng_key, observation, inputs)
        return FixedLagState(inner, jnp.broadcast_to(inner.particles, (lag + 1, *inner.particles.shape))), info

    def step(
        rng_key: Array, state: FixedLagState, observation: Observation, inputs: Any = None
    ) -> tuple[FixedLagState, FilterInfo]:
        inner, info = filter.step(rng_key, state.inner, observation, inputs)
        if info.ancestors.shape != inner.log_weights.shape:
            raise ValueError(
                f"The filter has {info.ancestors.shape} ancestors for {inner.log_weights.shape} particles. "
                "Use a particle filter, which keeps one ancestor for each particle."
            )
        window = jnp.concatenate([state.window[1:, info.ancestors], inner.particles[None]])
        return FixedLagState(inner, window), info

    return Filter(init, step, model=filter.model)


@memoized_builder
def fixed_lag_smoother(model: CompiledModel, *, lag: int = 10) -> Smoother:
    """Fixed-lag smoothing: the ancestors of the particles a few frames later.

    Args:
        model: The compiled model; not used, as everything stands in the history.
        lag: L, at least 0.

    Returns:
        The smoother. It raises a ValueError for a history whose ancestors are no genealogy.

    Raises:
        ValueError: A negative lag.
    """
    check_at_least(0, lag=lag)

    def smooth(rng_key: Array, history: History, observations: Observation, inputs: Any = None) -> Smoothed:
        check_genealogy(history)
        num_frames, num_particles, _ = history.particles.shape
        identity = jnp.arange(num_particles, dtype=history.ancestors.dtype)
        frames = jnp.arange(num_frames)

        def older(ancestry: Array, distance: Array) -> tuple[Array, None]:
            """From lines `distance` - 1 frames long, (T, N), to lines one frame longer, where there is such a frame."""
            ends = jnp.minimum(frames + lag, num_frames - 1)
            place = ends - distance + 1  # the frame that a line has reached
            further = jnp.take_along_axis(history.ancestors[jnp.maximum(place, 0)], ancestry, axis=1)
            return jnp.where((place > frames)[:, None], further, ancestry), None

        start = jnp.broadcast_to(identity, (num_frames, num_particles))
        ancestry, _ = jax.lax.scan(older, start, jnp.arange(1, min(lag, num_frames - 1) + 1))
        ends = normalise_rows(history.log_weights)[jnp.minimum(frames + lag, num_frames - 1)]
        particles = jnp.take_along_axis(history.particles, ancestry[..., None], axis=1)
        ess = jax.vmap(shared_ess)(jnp.exp(ends), ancestry)
        return Smoothed(particles, ends, smoothing_info(num_frames, ess))

    return Smoother(smooth, joint=False, requires_genealogy=True)


def normalise_rows(log_weights: Array) -> Array:
    """Normalised log-weights (T, N), each frame for itself."""
    return jax.vmap(lambda row: normalise(row).log_weights)(log_weights)
