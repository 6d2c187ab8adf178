"""Forward-backward smoothing with tables: transition densities of all pairs of particles, by look-up.

The smoother is that of :mod:`poseppl.smoothers.forward_backward`. Through a program each of N x N pairs would look up
rows of D x B probabilities; here it looks up D of them.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import jit
from poseppl.particles.weights import normalise
from poseppl_papers.peursum.factored_evidence import LogTables


class Particles(NamedTuple):
    """States of N particles.

    Attributes:
        phases: (N,).
        bins: (N, D).
        roots: (N, 4): x, y, z (mm), heading (radians).
    """

    phases: Array
    bins: Array
    roots: Array


class RootWalk(NamedTuple):
    """How position and heading go on.

    Attributes:
        scales: Standard deviations of a step (4,), mm and radians.
        strides: (M, 3), mm a frame of the video: forwards, to the left and up.
        stays: Probability () that the position does not follow the heading.
    """

    scales: Array
    strides: Array
    stays: Array


def log_transition_matrix(tables: LogTables, walk: RootWalk, later: Particles, earlier: Particles) -> Array:
    """Log-densities (N, N) of later particles (rows) after earlier ones."""

    def add(total: Array, joint: Array) -> tuple[Array, None]:
        towards = tables.steps[later.phases, joint, :, later.bins[:, joint]]
        return total + towards[:, earlier.bins[:, joint]], None

    start = tables.phases.T[later.phases][:, earlier.phases]
    steps, _ = jax.lax.scan(add, start, jnp.arange(later.bins.shape[1]))
    return steps + _log_roots(walk, later, earlier)


def _log_roots(walk: RootWalk, later: Particles, earlier: Particles) -> Array:
    place, turn = walk.scales[:3], walk.scales[3]
    heading = later.roots[:, 3]
    sine, cosine = jnp.sin(heading), jnp.cos(heading)
    ahead, left, up = walk.strides[later.phases].T
    stride = jnp.stack([-sine * ahead - cosine * left, cosine * ahead - sine * left, up], 1)
    apart = later.roots[:, None, :3] - earlier.roots[None, :, :3]
    stood = -0.5 * jnp.sum(jnp.square(apart / place), -1)
    walked = -0.5 * jnp.sum(jnp.square((apart - stride[:, None]) / place), -1)
    ways = jnp.logaddexp(jnp.log(walk.stays) + stood, jnp.log(1 - walk.stays) + walked)
    turned = -0.5 * jnp.square((heading[:, None] - earlier.roots[None, :, 3]) / turn)
    return ways + turned - jnp.sum(jnp.log(walk.scales)) - 2 * jnp.log(2 * jnp.pi)


def log_walk_matrix(scales: Array, later: Array, earlier: Array) -> Array:
    """Log-densities (N, N), but for a constant, of later poses (rows) after earlier ones (N, d) in a walk of Gaussian steps.

    The steps have standard deviations `scales` (d,). Squared distances come from one product of matrices, of poses without
    their mean, so that little is lost to rounding.
    """
    middle = jnp.mean(earlier, 0)
    after, before = (later - middle) / scales, (earlier - middle) / scales
    squared = jnp.sum(jnp.square(after), 1)[:, None] + jnp.sum(jnp.square(before), 1) - 2 * after @ before.T
    return -0.5 * jnp.maximum(squared, 0.0)


@jit
def reweigh(log_densities: Array, smoothed: Array, log_weights: Array) -> Array:
    """Smoothed log-weights (N,) of earlier particles, from log-densities (N, N) and smoothed ones of the later (N,).

    A later particle that is reached from none says nothing.
    """
    reached = jax.nn.logsumexp(log_densities + log_weights, axis=1)
    shares = jnp.where(jnp.isfinite(reached), smoothed - reached, -jnp.inf)
    found = normalise(log_weights + jax.nn.logsumexp(log_densities + shares[:, None], axis=0))
    return jnp.where(found.degenerate, log_weights, found.log_weights)
