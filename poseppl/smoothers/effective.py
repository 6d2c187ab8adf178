"""Draws, independent or of Markov chains, as the result of a smoother, and how many independent ones they amount to."""

from __future__ import annotations

from typing import Any

import blackjax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.marginals import Marginals
from poseppl.smoothers.base import Smoothed, smoothing_info


def smoothed_chains(draws: Array, **diagnosis: Any) -> Smoothed:
    """The result of chains (T, M, R, d), whose draws weigh the same; what else there is to say goes to `smoothing_info`."""
    info = smoothing_info(len(draws), effective_draws_by_frame(draws), **diagnosis)
    return Smoothed(draws, jnp.zeros(draws.shape[:-1], draws.dtype), info)


def smoothed_draws(draws: Array, marginals: Marginals | None = None, **diagnosis: Any) -> Smoothed:
    """The result of independent trajectories (T, N, d) of one weight; what else there is to say goes to `smoothing_info`."""
    num_frames, num_draws = draws.shape[:2]
    log_weights = jnp.full((num_frames, num_draws), -jnp.log(num_draws), draws.dtype)
    return Smoothed(draws, log_weights, smoothing_info(num_frames, jnp.asarray(num_draws), **diagnosis), marginals)


def effective_draws_by_frame(particles: Array) -> Array:
    """Effective number of draws (T,) of chains (T, M, R, d): that of the worst coordinate's mean, from 1 to M R."""
    num_frames, num_chains, num_draws, dimension = particles.shape
    if num_draws < 4:
        return jnp.full(num_frames, float(num_chains), particles.dtype)
    chains = jnp.moveaxis(particles, 0, 2).reshape(num_chains, num_draws, -1)
    ess = blackjax.diagnostics.effective_sample_size(chains).reshape(num_frames, dimension)
    worst = jnp.min(jnp.where(jnp.isnan(ess), 1.0, ess), 1)
    return jnp.clip(worst, 1.0, num_chains * num_draws)
