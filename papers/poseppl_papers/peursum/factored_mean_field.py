r"""The variational smoother of the FS-HHMM on the mixture (section 4.4, Eqs. 24 to 27).

The paper leaves the updates to a report. With Q = prod_t q(q_t) prod_d q(x_t^d) q(s_t) q(v_t, u_t), all factors free, the
divergence is least, the others given, at

    log q(q_t = m)   = E log C[q_(t-1), m] + sum_d E log A_m^d[x_(t-1), x_t] + E log C[m, q_(t+1)] + const,
    log q(x_t^d = j) = E log A^d[q_t, x_(t-1), j] + E log A^d[q_(t+1), j, x_(t+1)] + sum_k q(s_t = k) log N(j; y_k, R) + const,
    log q(s_t = k)   = log eta_k + sum_d E log N(x_t^d; y_k, R) + E log N(v_t, u_t; y_k, R) + const,
    q(v_t, u_t)      normal: precision 1 / Sigma + 1 / R, mean the weighted one of mu and sum_k q(s_t = k) y_k;

the first frame has phi and varphi in place of C and A. The end flags follow from (q_t, x_(t-1)) and cancel. A round takes the
frames from left to right, and each from top to bottom: q, x, s, then v and u. Each step lowers

    F = E log Q - E log P(x, s, q, v, u, y),

the divergence up to the log-evidence (Eq. 25); rounds go on until it falls by less than a share of itself.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.particles.stacks import tree_index
from poseppl_papers.peursum.factored_evidence import (
    ROOT,
    FactoredPosterior,
    LogTables,
    Mixtures,
    bin_log_likelihoods,
)


class Marginals(NamedTuple):
    """Q of T frames, or of one.

    Attributes:
        phases: (T, M).
        bins: (T, D, B).
        chosen: Probabilities of the components (T, K).
        root_mean: (T, 4).
    """

    phases: Array
    bins: Array
    chosen: Array
    root_mean: Array


def start_marginals(phases: Array, bins: Array, log_weights: Array, sizes: tuple[int, int], mixtures: Mixtures) -> Marginals:
    """Q as the filter's particles have it (section 5.2).

    Args:
        phases: Phases of the particles (T, N).
        bins: Likewise (T, N, D).
        log_weights: Normalised (T, N).
        sizes: Numbers of phases and of bins.
        mixtures: Whose weights are those of the components, and whose prior is that of the root.
    """
    weights = jnp.exp(log_weights)

    def histogram(values: Array, weight: Array, size: int) -> Array:
        return jnp.zeros(size).at[values.astype(int)].add(weight)

    rotations = jax.vmap(jax.vmap(histogram, (1, None, None)), (0, 0, None))(bins, weights, sizes[1])
    found = jax.vmap(histogram, (0, 0, None))(phases, weights, sizes[0])
    return Marginals(found, rotations, jax.nn.softmax(mixtures.log_weights, -1), mixtures.prior_mean)


def mean_field(
    tables: LogTables, mixtures: Mixtures, start: Marginals, max_rounds: int = 50, tolerance: float = 1e-4
) -> tuple[FactoredPosterior, Array, Array]:
    """Find Q.

    Args:
        tables: Tables of the motion.
        mixtures: In place of the likelihoods.
        start: Start of Q.
        max_rounds: At most so many.
        tolerance: Share of F by which it falls at least in a round.

    Returns:
        Q, F after each round (max_rounds,) with NaN after the last, and the number of rounds.
    """
    first = free_energy(tables, mixtures, start)

    def goes_on(state: tuple[Marginals, Array, Array, Array]) -> Array:
        _, _, count, fall = state
        return (count < max_rounds) & fall

    def update(state: tuple[Marginals, Array, Array, Array]) -> tuple[Marginals, Array, Array, Array]:
        q, trace, count, _ = state
        q = sweep(tables, mixtures, q)
        energy = free_energy(tables, mixtures, q)
        before = jnp.where(count > 0, trace[count - 1], first)
        return q, trace.at[count].set(energy), count + 1, before - energy > tolerance * jnp.abs(energy)

    begun = start, jnp.full(max_rounds, jnp.nan), jnp.array(0), jnp.array(True)
    q, trace, count, _ = jax.lax.while_loop(goes_on, update, begun)
    variance = jnp.broadcast_to(1 / mixtures.precision, q.root_mean.shape)
    return FactoredPosterior(q.phases, q.bins, q.root_mean, variance), trace, count


def sweep(tables: LogTables, mixtures: Mixtures, q: Marginals) -> Marginals:
    """One round over all frames."""
    frames = q.phases.shape[0]

    def visit(q: Marginals, t: Array) -> tuple[Marginals, None]:
        own, seen = tree_index(q, t), tree_index(mixtures, t)
        likelihoods = bin_log_likelihoods(seen.rotations, q.bins.shape[-1])
        (came, moved), (goes, leads) = _left(tables, q, t), _right(tables, q, t)
        phases = jax.nn.softmax(came + jnp.einsum("mdb,db->m", moved, own.bins) + goes)
        scores = jnp.einsum("m,mdb->db", phases, moved) + leads + jnp.einsum("k,kdb->db", own.chosen, likelihoods)
        bins = jax.nn.softmax(scores, -1)
        chosen = jax.nn.softmax(_component_scores(seen, likelihoods, bins, own.root_mean))
        root = seen.root_mean(chosen @ seen.roots)
        new = Marginals(phases, bins, chosen, root)
        return jax.tree.map(lambda whole, part: whole.at[t].set(part), q, new), None

    return jax.lax.scan(visit, q, jnp.arange(frames))[0]


def _left(tables: LogTables, q: Marginals, t: Array) -> tuple[Array, Array]:
    """Messages of the previous frame: scores of phases (M,), and of bins given each phase (M, D, B)."""
    before = tree_index(q, jnp.maximum(t - 1, 0))
    bins = jnp.where(t > 0, jnp.einsum("di,mdij->mdj", before.bins, tables.steps), tables.first_bins)
    return jnp.where(t > 0, before.phases @ tables.phases, tables.first_phase), bins


def _right(tables: LogTables, q: Marginals, t: Array) -> tuple[Array, Array]:
    """Messages of the next frame: scores of phases (M,), and of bins (D, B)."""
    there = t + 1 < q.phases.shape[0]
    after = tree_index(q, jnp.where(there, t + 1, t))
    follows = jnp.einsum("mdij,dj->mdi", tables.steps, after.bins)
    scores = tables.phases @ after.phases, jnp.einsum("m,mdi->di", after.phases, follows)
    return jnp.where(there, scores[0], 0.0), jnp.where(there, scores[1], 0.0)


def _component_scores(seen: Mixtures, likelihoods: Array, bins: Array, root: Array) -> Array:
    """Log eta_k + E log N of rotations and root (K,), up to a constant."""
    spread = 1 / seen.precision
    apart = (jnp.square(root - seen.roots) + spread) / jnp.square(jnp.asarray(ROOT))
    return seen.log_weights + jnp.einsum("kdb,db->k", likelihoods, bins) - 0.5 * jnp.sum(apart, -1)


def free_energy(tables: LogTables, mixtures: Mixtures, q: Marginals) -> Array:
    """F (), Gaussians of components and priors taken without their constants."""
    frames = q.phases.shape[0]

    def of_frame(t: Array) -> Array:
        own, seen = tree_index(q, t), tree_index(mixtures, t)
        came, moved = _left(tables, q, t)
        phase_scores = came + jnp.einsum("mdb,db->m", moved, own.bins)
        likelihoods = bin_log_likelihoods(seen.rotations, q.bins.shape[-1])
        seen_scores = _component_scores(seen, likelihoods, own.bins, own.root_mean)
        spread = 1 / seen.precision
        prior = -0.5 * jnp.sum((jnp.square(own.root_mean - seen.prior_mean) + spread) / seen.prior_variance)
        there = jnp.where(own.chosen > 0, own.chosen * seen_scores, 0.0)
        expected = jnp.sum(own.phases * phase_scores) + jnp.sum(there) + prior
        entropy = _entropy(own.phases) + _entropy(own.bins) + _entropy(own.chosen)
        return -expected - entropy - 0.5 * jnp.sum(jnp.log(2 * jnp.pi * jnp.e * spread))

    return jnp.sum(jax.lax.map(of_frame, jnp.arange(frames)))


def _entropy(shares: Array) -> Array:
    return -jnp.sum(jax.scipy.special.xlogy(shares, shares))
