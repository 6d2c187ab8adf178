"""The two smoothers of the FS-HHMM against enumeration of tiny models: T = 3, M = 2, D = 2, B = 4, K = 2."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from poseppl_papers.peursum.factored_draws import Draw, gibbs
from poseppl_papers.peursum.factored_evidence import (
    ROOT,
    Mixtures,
    bin_log_likelihoods,
    diffusion_tables,
    fit_mixtures,
    log_tables,
)
from poseppl_papers.peursum.factored_mean_field import Marginals, free_energy, mean_field, sweep

from poseppl.motion.learned import FactoredTables, bin_angles

T, M, D, B, K = 3, 2, 2, 4, 2
FLOOR = 1e-3


def tiny(seed: int) -> FactoredTables:
    rng = np.random.default_rng(seed)
    steps = rng.dirichlet(np.ones(B), (M, D, B))
    steps[0, 0, 1] = steps[1, 1, 2:] = 0.0
    rows = [rng.dirichlet(np.ones(n), shape) for n, shape in ((M, ()), (B, (M, D)), (M, M), (B, (M, D)))]
    return FactoredTables(*(jnp.asarray(row, float) for row in (*rows, steps, np.zeros((M, 3)))))


def mixtures_of(seed: int, num: int = K) -> Mixtures:
    """Components halfway between the same two bins: bins are far apart, and a sampler is to come from one to the other."""
    rng = np.random.default_rng(seed + 100)
    middles = np.asarray(bin_angles(np.arange(B), B))
    between = middles[rng.integers(0, B, (T, 1, D))] + np.pi / 4 + np.radians(0.1) * rng.normal(size=(T, num, D))
    return Mixtures(
        jnp.log(jnp.asarray(rng.dirichlet(np.ones(num), T), float)),
        jnp.asarray(between, float),
        jnp.asarray(rng.normal(size=(T, num, 4)) * np.array(ROOT), float),
        jnp.asarray(rng.normal(size=(T, 4)) * np.array(ROOT), float),
        jnp.asarray(rng.uniform(0.5, 2.0, (T, 4)) * np.square(ROOT), float),
    )


def values() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All phases (n, T), bins (n, T, D) and components (n, T)."""
    ranges = [range(M)] * T + [range(B)] * (T * D) + [range(K)] * T
    every = np.array(list(itertools.product(*ranges)), np.int16)
    return every[:, :T], every[:, T : T + T * D].reshape(-1, T, D), every[:, T + T * D :]


PHASES, BINS, CHOSEN = values()


def log_joint(tables: FactoredTables, mixtures: Mixtures, floor: float = FLOOR, ends: bool = True) -> np.ndarray:
    """log P of all values, but for the root, by Eqs. 7a to 7f, 22a and 22b."""

    def floored(rows):
        rows = np.asarray(rows, np.float64)
        return np.log((1 - floor) * rows + floor / rows.shape[-1])

    steps = np.asarray(tables.steps, np.float64)
    if ends:
        entries = np.broadcast_to(np.asarray(tables.entries, np.float64)[:, :, None, :], steps.shape)
        steps = np.where(steps.sum(-1, keepdims=True) == 0, entries, steps)
    first, first_bins, phases, steps = (floored(x) for x in (tables.first_phase, tables.first_bins, tables.phases, steps))
    total = first[PHASES[:, 0]] + sum(first_bins[PHASES[:, 0], d, BINS[:, 0, d]] for d in range(D))
    for t in range(1, T):
        total = total + phases[PHASES[:, t - 1], PHASES[:, t]]
        total = total + sum(steps[PHASES[:, t], d, BINS[:, t - 1, d], BINS[:, t, d]] for d in range(D))
    for t in range(T):
        seen = np.asarray(bin_log_likelihoods(mixtures.rotations[t], B), np.float64)
        total = total + np.asarray(mixtures.log_weights, np.float64)[t, CHOSEN[:, t]]
        total = total + sum(seen[CHOSEN[:, t], d, BINS[:, t, d]] for d in range(D))
    return total


def log_roots(mixtures: Mixtures) -> np.ndarray:
    """log of the integral over the root of each frame and component (T, K), Gaussians without their constants."""
    mean, variance, roots = (np.asarray(x, np.float64) for x in (mixtures.prior_mean, mixtures.prior_variance, mixtures.roots))
    own = np.square(np.array(ROOT))
    apart = np.square(roots - mean[:, None]) / (own + variance[:, None])
    spread = 2 * np.pi / (1 / own + 1 / variance[:, None])
    return (-0.5 * apart + 0.5 * np.log(spread)).sum(-1)


def exact(tables, mixtures, **settings):
    """Log-evidence, and probabilities of phases (T, M), of bins (T, D, B) and of components (T, K)."""
    log_p = log_joint(tables, mixtures, **settings) + log_roots(mixtures)[np.arange(T), CHOSEN].sum(-1)
    evidence = np.logaddexp.reduce(log_p)
    p = np.exp(log_p - evidence)

    def marginal(column, size):
        return np.bincount(column, p, size)

    phases = np.array([marginal(PHASES[:, t], M) for t in range(T)])
    bins = np.array([[marginal(BINS[:, t, d], B) for d in range(D)] for t in range(T)])
    return evidence, phases, bins, np.array([marginal(CHOSEN[:, t], K) for t in range(T)])


def any_q(seed: int, mixtures: Mixtures, num: int = K, phases: int = M) -> Marginals:
    rng = np.random.default_rng(seed + 200)
    shares = [rng.dirichlet(np.ones(n), shape) for n, shape in ((phases, T), (B, (T, D)), (num, T))]
    return Marginals(*(jnp.asarray(x, float) for x in shares), mixtures.prior_mean)


@pytest.mark.full
@pytest.mark.parametrize("seed", range(3))
def test_the_free_energy_is_the_divergence_up_to_the_evidence(seed):
    tables, mixtures = tiny(seed), mixtures_of(seed)
    q = any_q(seed, mixtures)
    phases, bins, chosen = (np.asarray(x, np.float64) for x in (q.phases, q.bins, q.chosen))
    frames, rotations = np.arange(T), np.arange(D)
    share = phases[frames, PHASES].prod(1) * chosen[frames, CHOSEN].prod(1)
    share = share * bins[frames[:, None], rotations, BINS].prod((1, 2))
    own, prior = np.square(np.array(ROOT)), np.asarray(mixtures.prior_variance, np.float64)
    spread = 1 / (1 / own + 1 / prior)
    apart = np.square(np.asarray(q.root_mean)[:, None] - np.asarray(mixtures.roots)) + spread[:, None]
    quadratic = -0.5 * (chosen * (apart / own).sum(-1)).sum() - 0.5 * (spread / prior).sum()
    entropy_root = 0.5 * np.log(2 * np.pi * np.e * spread).sum()
    expected = (share * (np.log(share) - log_joint(tables, mixtures))).sum() - quadratic - entropy_root
    np.testing.assert_allclose(free_energy(log_tables(tables, FLOOR), mixtures, q), expected, rtol=1e-4)
    assert expected > -exact(tables, mixtures)[0]


@pytest.mark.full
@pytest.mark.parametrize("seed", range(8))
def test_the_free_energy_never_rises_and_bounds_the_evidence(seed):
    tables, mixtures = tiny(seed), mixtures_of(seed)
    start, logs = any_q(seed, mixtures), log_tables(tables, FLOOR)
    _, trace, count = mean_field(logs, mixtures, start, 50, 1e-7)
    energies = np.array([float(free_energy(logs, mixtures, start)), *np.asarray(trace)[: int(count)]])
    assert np.all(np.diff(energies) <= 2e-6 * np.abs(energies[1:]))  # rounding of float32
    assert energies[-1] > -exact(tables, mixtures)[0] - 1e-3


@pytest.mark.full
@pytest.mark.parametrize("seed", range(4))
def test_no_other_bins_have_a_lower_free_energy(seed):
    """At the end of the rounds, the bins of a frame and rotation are the best, given the others."""
    tables, mixtures = tiny(seed), mixtures_of(seed)
    logs = log_tables(tables, FLOOR)
    ended = jax.lax.fori_loop(0, 200, lambda _, q: sweep(logs, mixtures, q), any_q(seed, mixtures))
    least = float(free_energy(logs, mixtures, ended))
    for t, d, b in itertools.product(range(T), range(D), range(B)):
        moved = 0.9 * ended.bins[t, d] + 0.1 * jnp.eye(B)[b]
        other = ended._replace(bins=ended.bins.at[t, d].set(moved))
        assert float(free_energy(logs, mixtures, other)) > least - 2e-3  # float32 of some 600


@pytest.mark.full
def test_mean_field_is_exact_where_the_posterior_factorises():
    """One phase, steps that do not look back, one component."""
    rng, mixtures = np.random.default_rng(0), mixtures_of(0, 1)
    row = jnp.asarray(rng.dirichlet(np.ones(B), (1, D)), float)
    steps = jnp.broadcast_to(row[:, :, None], (1, D, B, B))
    tables = FactoredTables(jnp.ones(1), row, jnp.ones((1, 1)), row, steps, jnp.zeros((1, 3)))
    found, _, _ = mean_field(log_tables(tables, FLOOR), mixtures, any_q(0, mixtures, 1, 1))
    scores = np.log((1 - FLOOR) * np.asarray(row[0]) + FLOOR / B)[None] + np.array(
        [bin_log_likelihoods(mixtures.rotations[t], B)[0] for t in range(T)]
    )
    expected = np.exp(scores - np.logaddexp.reduce(scores, -1, keepdims=True))
    np.testing.assert_allclose(found.bins, expected, atol=1e-4)


def drawn(tables: FactoredTables, mixtures: Mixtures, chains: int = 24, rounds: int = 2000):
    """Means and standard errors over chains of the marginals of phases and bins."""
    start = Draw(jnp.zeros(T, int), jnp.zeros((T, D), int), jnp.zeros(T, int), mixtures.prior_mean)
    keys = jax.random.split(jax.random.key(3), chains)
    run = jax.jit(jax.vmap(lambda key: gibbs(key, log_tables(tables, FLOOR), mixtures, start, rounds)))
    found = run(keys)
    pairs = [np.asarray(x, np.float64) for x in (found.phases, found.bins)]
    return [x.mean(0) for x in pairs], [x.std(0, ddof=1) / np.sqrt(chains) + 1e-5 for x in pairs]


@pytest.mark.full
@pytest.mark.parametrize("seed", range(2))
def test_gibbs_comes_to_the_enumeration(seed):
    tables, mixtures = tiny(seed), mixtures_of(seed)
    _, phases, bins, _ = exact(tables, mixtures)
    means, errors = drawn(tables, mixtures)
    assert np.max(np.abs(means[0] - phases) / errors[0]) < 5
    assert np.max(np.abs(means[1] - bins) / errors[1]) < 5
    _, phases, bins, _ = exact(tables, mixtures, ends=False)  # rows of no successor, floored instead of entered
    assert np.max(np.abs(means[1] - bins) / errors[1]) > 10


@pytest.mark.full
def test_the_mixture_stands_where_the_weights_are():
    """Particles around two poses of unequal weight: components share the weight as the particles do."""
    rng = np.random.default_rng(0)
    near = rng.random(400) < 0.5
    rotations = np.where(near[:, None], np.pi - 0.02, -1.0) + np.radians(1.0) * rng.normal(size=(400, 3))
    roots = rng.normal(size=(400, 4)) * np.array(ROOT) + np.array([1000.0, -500.0, 900.0, np.pi])
    weights = np.where(near, 3.0, 1.0)
    weights /= weights.sum()
    inputs = (jnp.asarray(x[None], float) for x in (rotations, roots, np.log(weights)))
    mixtures = fit_mixtures(jax.random.key(0), *inputs, max_components=300)
    share, middles = np.exp(np.asarray(mixtures.log_weights[0], np.float64)), np.asarray(mixtures.rotations[0])
    assert 0.9 * near.sum() < np.sum(share > 0) <= near.sum()  # those below the average are none
    at_first = np.cos(middles[:, 0] - np.pi) > 0.9
    np.testing.assert_allclose(share[at_first].sum(), weights[near].sum(), atol=1e-3)
    np.testing.assert_allclose(mixtures.prior_mean[0, :3], weights @ roots[:, :3], rtol=1e-4)
    apart = np.square(roots[:, :3] - weights @ roots[:, :3])
    np.testing.assert_allclose(mixtures.prior_variance[0, :3], weights @ apart, rtol=1e-3)


@pytest.mark.full
def test_diffusion_in_bins():
    tables = diffusion_tables(jnp.array([0.1, 0.3]), 120)
    angles = np.asarray(bin_angles(np.arange(120)), np.float64)
    apart = np.angle(np.exp(1j * (angles[None] - angles[:, None])))
    for rotation, scale in enumerate((0.1, 0.3)):
        rows = np.asarray(tables.steps[0, rotation], np.float64)
        np.testing.assert_allclose(np.sqrt((rows * apart**2).sum(1)), scale, rtol=1e-3)
        np.testing.assert_allclose(rows.sum(1), 1.0, atol=1e-5)
