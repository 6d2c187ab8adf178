"""Laplace's approximation with marginalised errors, against that of states and errors together, by dense matrices."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.gaussians.walk_chains import WalkChains, ar1_chains
from poseppl.smoothers.marginal_errors import Mode, SeenWalk, Unchanging, find_mode, gaussian_around

T, N, M, RATIO, STRENGTH = 12, 3, 3, 1.2, 6.0


class Dense(NamedTuple):
    """A view (M, T, 2, N) whose reduced errors are all errors."""

    jacobian: Floats

    def seen(self, x: Floats) -> Floats:
        return np.einsum("mtij,tnj->nmti", self.jacobian, x)

    def pulled(self, z: Floats) -> Floats:
        return np.einsum("mtij,nmti->tnj", self.jacobian, z)

    def reduced(self, weight: Floats, ratio: float) -> tuple[int, Iterator[Floats]]:
        return 2 * M, (joint_rows(self, t).T @ spread_out(weight, t) @ joint_rows(self, t) for t in range(T))

    def reduced_noise(self, weight: Floats, ratio: float, rng: np.random.Generator, count: int) -> Floats:
        values, vectors = np.linalg.eigh(np.stack([spread_out(weight, t) for t in range(T)]))
        roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        noise = roots @ rng.standard_normal((T, 2 * M, count))
        return np.stack([(joint_rows(self, t).T @ noise[t]).T for t in range(T)])


def joint_rows(view: Dense, frame: int) -> Floats:
    """Derivatives of a frame's data (2 M) by its states and errors."""
    return np.concatenate([view.jacobian[:, frame].reshape(2 * M, N), RATIO * np.eye(2 * M)], 1)


def spread_out(weight: Floats, frame: int) -> Floats:
    whole = np.zeros((2 * M, 2 * M))
    for m in range(M):
        whole[2 * m : 2 * m + 2, 2 * m : 2 * m + 2] = weight[m, frame]
    return whole


class Case(NamedTuple):
    """A trajectory, what is seen of it, and its chains with those of the errors beside."""

    problem: SeenWalk
    view: Dense
    whole: WalkChains


@pytest.fixture(scope="module")
def case() -> Case:
    """One coordinate that walks along its velocity, one beside it; the data of a camera are missing for some time."""
    rng = np.random.default_rng(0)
    one, kept = np.ones((T, 1)), np.full(T, 0.8)
    first = np.r_[0.0, np.ones(T - 1)][:, None]
    walk = WalkChains(one / 0.3, first / 0.3, -first / 0.6, first / 0.6, np.zeros((T, 1)))
    chains = walk.beside(ar1_chains(np.full(T, 0.9), 1.0, 1)).beside(ar1_chains(np.full(T, 0.95), 0.5, 1))
    jacobian = rng.normal(size=(M, 1, 2, N)) * np.array([1.0, 0.0, 1.0]) + np.zeros((M, T, 2, N))
    known = np.ones((M, T), bool)
    known[1, 4:9] = False
    jacobian[~known] = 0.0
    data = 2.0 * rng.standard_t(4.0, (M, T, 2))
    view = Dense(jacobian)

    def residuals(x: Floats) -> Floats:
        return np.where(known[..., None], data - view.seen(x[:, None])[0], 0.0)

    problem = SeenWalk(chains, kept, RATIO, STRENGTH, known, residuals, lambda _: view)
    return Case(problem, view, chains.beside(ar1_chains(kept, 1.0, 2 * M)))


def potential(case: Case, both: Floats) -> float:
    states = both.reshape(T, N + 2 * M)
    off = case.whole.innovations(states[:, None])[:, 0]
    u = case.problem.residuals(states[:, :N]) - RATIO * states[:, N:].reshape(T, M, 2).swapaxes(0, 1)
    data = STRENGTH * np.log1p((u**2).sum(-1)[case.problem.known] / STRENGTH)
    return float(0.5 * (off**2).sum() + 0.5 * data.sum())


@pytest.fixture(scope="module")
def mode(case: Case) -> Mode:
    return find_mode(case.problem, np.zeros((T, N)), least=1e-9)


def curvature(u: Floats, known: Floats, spread: Floats) -> Floats:
    """The robust errors' curvature at errors as large as they are expected to be."""
    outer = u[..., :, None] * u[..., None, :] + spread
    first = 1 / (1 + np.trace(outer, axis1=-2, axis2=-1) / STRENGTH)[..., None, None]
    values, vectors = np.linalg.eigh(first * np.eye(2) - 2 / STRENGTH * first**2 * outer)
    return np.where(
        known[..., None, None], (vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2), 0.0
    )


def dense_covariance(case: Case, mode: Mode) -> tuple[Floats, Floats, Floats]:
    """Precision of all frames' states and errors, with the rows (T, 2 M, n) of the data, and their weights (M, T, 2, 2)."""
    size = N + 2 * M
    each = np.moveaxis(np.eye(T * size).reshape(-1, T, size), 0, 1)
    root = np.moveaxis(case.whole.innovations(each), 1, -1).reshape(T * size, T * size)
    rows = np.stack([joint_rows(case.view, t) for t in range(T)])
    u, spread = case.problem.residuals(mode.x) - RATIO * mode.errors, np.zeros((M, T, 2, 2))
    for _ in range(2):
        weight, whole = curvature(u, case.problem.known, spread), root.T @ root
        for t in range(T):
            at = slice(t * size, (t + 1) * size)
            whole[at, at] += rows[t].T @ spread_out(weight, t) @ rows[t]
        covariance = np.linalg.inv(whole)
        for t in range(T):
            at = slice(t * size, (t + 1) * size)
            off = rows[t] @ covariance[at, at] @ rows[t].T
            spread[:, t] = [off[2 * m : 2 * m + 2, 2 * m : 2 * m + 2] for m in range(M)]
    return covariance, rows, weight


def test_the_mode_is_that_of_states_and_errors_together(case: Case, mode: Mode) -> None:
    """A step of Newton's from it, in both, leads nowhere."""
    found = np.concatenate([mode.x, mode.errors.swapaxes(0, 1).reshape(T, -1)], 1).ravel()
    steps = 1e-4 * np.eye(len(found))
    slope = np.array([potential(case, found + step) - potential(case, found - step) for step in steps]) / 2e-4
    covariance, _, _ = dense_covariance(case, mode)
    deviation = np.sqrt(np.diag(covariance))
    assert np.abs(covariance @ slope / deviation).max() < 1e-3


def test_standard_deviations_are_those_of_states_and_errors_together(case: Case, mode: Mode) -> None:
    """Within 3 %, of which some is Monte Carlo error of how large errors are expected to be; draws within four of theirs."""
    draws = 3000
    around = gaussian_around(case.problem, mode, np.random.default_rng(1), draws)
    covariance, _, _ = dense_covariance(case, mode)
    expected = np.sqrt(np.diag(covariance).reshape(T, -1)[:, :N])
    ratio = np.sqrt(around.variance) / expected
    assert abs(np.median(ratio) - 1) < 0.03 and np.abs(ratio - 1).max() < 0.08, ratio
    drawn = around.steps.std(1) / np.sqrt(around.variance)
    assert np.abs(drawn - 1).max() < 4.5 / np.sqrt(2 * draws), drawn
    together = np.einsum("ni,nj->ij", around.steps[3], around.steps[4]) / draws
    size = N + 2 * M
    block = covariance.reshape(T, size, T, size)[3, :N, 4, :N]
    assert np.abs(together - block).max() < 0.1 * np.abs(block).max()


def test_what_does_not_change_keeps_its_prior_and_the_rest_follows(case: Case, mode: Mode) -> None:
    """States fall by R c, R the response of the mode to c; their variance contains that of c."""
    rng = np.random.default_rng(2)
    seen = np.where(case.problem.known[..., None], rng.normal(size=(2, M, T, 2)), 0.0)
    root, draws = np.array([[0.5, 0.0], [0.2, 0.4]]), 400
    told = Unchanging(root, lambda part: seen[part])
    exact, around = (gaussian_around(case.problem, mode, np.random.default_rng(1), draws, each) for each in (None, told))
    covariance, rows, weight = dense_covariance(case, mode)
    size = N + 2 * M
    right = np.concatenate([rows[t].T @ spread_out(weight, t) @ seen[:, :, t].reshape(2, -1).T for t in range(T)])
    response = (covariance @ right).reshape(T, size, 2)[:, :N]
    more = np.square(response @ root).sum(-1)
    np.testing.assert_allclose(around.variance - exact.variance, more, rtol=0.15, atol=0.05 * more.max())
    np.testing.assert_allclose(np.cov(around.unchanging.T, bias=True), root @ root.T, atol=1e-10)
    follow = np.einsum("tni,nj->tij", around.steps, around.unchanging) / draws
    error = np.sqrt(around.variance)[..., None] * np.sqrt(np.diag(root @ root.T) / draws)
    assert np.abs((follow + response @ root @ root.T) / error).max() < 4.5


def test_a_bad_start_leads_to_the_same_mode(case: Case, mode: Mode) -> None:
    other = find_mode(case.problem, np.random.default_rng(3).normal(size=(T, N)) * 20.0, least=1e-9)
    np.testing.assert_allclose(other.x, mode.x, atol=1e-3)
