"""Smoothers of the FS-HHMM that draw states: Gibbs sampling on the mixture (section 4.5), and forward-backward with tables.

A round takes the frames from left to right, and each from top to bottom: the phase, the rotations, which are independent given
it, the component, position and heading. Histograms of what is drawn after a burn-in are the marginals. Published are 2,000
rounds for the learned motion and 5,000 for the generic ones, the first 5 % left out, from the most likely particle of each
frame.

The smoother is that of :mod:`poseppl.smoothers.forward_backward`. Through a program each of N x N pairs would look up
rows of D x B probabilities; here it looks up D of them.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import jit
from poseppl.motion.learned import bin_angles
from poseppl.motion.learned.angles import wrapped
from poseppl.particles.stacks import tree_index
from poseppl.particles.weights import normalise
from poseppl_papers.peursum.factored_evidence import (
    ROOT,
    ROTATION,
    FactoredPosterior,
    LogTables,
    Mixtures,
)

BURN_IN = 0.05


class Draw(NamedTuple):
    """One value of all states of T frames, or of one.

    Attributes:
        phase: (T,).
        bins: (T, D).
        chosen: Components (T,).
        root: (T, 4), mm and radians.
    """

    phase: Array
    bins: Array
    chosen: Array
    root: Array


def gibbs(rng_key: Array, tables: LogTables, mixtures: Mixtures, start: Draw, num_rounds: int) -> FactoredPosterior:
    """Run the sampler.

    Args:
        rng_key: PRNG key.
        tables: Tables of the motion.
        mixtures: In place of the likelihoods.
        start: Start of the chain.
        num_rounds: Rounds, of which the first 5 % are left out.
    """
    frames, sizes = jnp.arange(len(start.phase)), (tables.phases.shape[0], tables.steps.shape[-1])
    towards = jnp.swapaxes(tables.steps, -1, -2)
    burn_in = int(BURN_IN * num_rounds)

    def run(state: tuple[Draw, FactoredPosterior], number: Array) -> tuple[tuple[Draw, FactoredPosterior], None]:
        draw, sums = state
        draw = sweep(jax.random.fold_in(rng_key, number), tables, towards, mixtures, draw)
        kept = jnp.where(number >= burn_in, 1.0, 0.0)
        joints = jnp.arange(draw.bins.shape[1])
        apart = draw.root - mixtures.prior_mean
        new = FactoredPosterior(
            sums.phases.at[frames, draw.phase].add(kept),
            sums.bins.at[frames[:, None], joints, draw.bins].add(kept),
            sums.root_mean + kept * apart,
            sums.root_variance + kept * jnp.square(apart),
        )
        return (draw, new), None

    zeros = FactoredPosterior(
        jnp.zeros((len(frames), sizes[0])),
        jnp.zeros((len(frames), start.bins.shape[1], sizes[1])),
        jnp.zeros_like(mixtures.prior_mean),
        jnp.zeros_like(mixtures.prior_mean),
    )
    (_, sums), _ = jax.lax.scan(run, (start, zeros), jnp.arange(num_rounds))
    means: FactoredPosterior = jax.tree.map(lambda total: total / (num_rounds - burn_in), sums)
    variance = means.root_variance - jnp.square(means.root_mean)
    return means._replace(root_mean=mixtures.prior_mean + means.root_mean, root_variance=variance)


def sweep(rng_key: Array, tables: LogTables, towards: Array, mixtures: Mixtures, draw: Draw) -> Draw:
    """One round over all frames; `towards` (M, D, B, B) are the steps with the bin after first."""
    frames, rotations = draw.bins.shape
    key_uniform, key_normal = jax.random.split(rng_key)
    uniforms = jax.random.uniform(key_uniform, (frames, rotations + 2))
    normals = jax.random.normal(key_normal, draw.root.shape)
    joints = jnp.arange(rotations)

    def visit(draw: Draw, row: tuple[Array, Array, Array]) -> tuple[Draw, None]:
        t, uniform, normal = row
        own, seen = tree_index(draw, t), tree_index(mixtures, t)
        before, after = tree_index(draw, jnp.maximum(t - 1, 0)), tree_index(draw, jnp.minimum(t + 1, frames - 1))
        first, last = t == 0, t + 1 == frames
        came = jnp.where(first, tables.first_phase, tables.phases[before.phase])
        moved = jnp.where(first, tables.first_bins[:, joints, own.bins], tables.steps[:, joints, before.bins, own.bins])
        goes = jnp.where(last, 0.0, tables.phases[:, after.phase])
        phase = _categorical(uniform[0], came + moved.sum(-1) + goes)
        came = jnp.where(first, tables.first_bins[phase], tables.steps[phase, joints, before.bins])
        goes = jnp.where(last, 0.0, towards[after.phase, joints, after.bins])
        angles = bin_angles(jnp.arange(came.shape[-1]), came.shape[-1])
        apart = wrapped(angles - seen.rotations[own.chosen][:, None]) / ROTATION
        bins = _categorical(uniform[2:], came + goes - 0.5 * jnp.square(apart))
        apart = wrapped(angles[bins] - seen.rotations) / ROTATION
        away = (own.root - seen.roots) / jnp.asarray(ROOT)
        fits = -0.5 * (jnp.sum(jnp.square(apart), -1) + jnp.sum(jnp.square(away), -1))
        chosen = _categorical(uniform[1], seen.log_weights + fits)
        root = seen.root_mean(seen.roots[chosen]) + normal / jnp.sqrt(seen.precision)
        new = Draw(phase, bins, chosen, root)
        return jax.tree.map(lambda whole, part: whole.at[t].set(part.astype(whole.dtype)), draw, new), None

    return jax.lax.scan(visit, draw, (jnp.arange(frames), uniforms, normals))[0]


def _categorical(uniform: Array, logits: Array) -> Array:
    """Draws (...) by the inverse distribution function of logits (..., n), from uniforms (...)."""
    below = jnp.cumsum(jax.nn.softmax(logits, -1), -1)
    drawn = jnp.sum(below < uniform[..., None] * below[..., -1:], -1)
    return jnp.minimum(drawn, logits.shape[-1] - 1)


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
