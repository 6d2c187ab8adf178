"""Chains that walk along velocities, and autoregressive errors, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from poseppl.arrays import Floats
from poseppl.gaussians.ar1_errors import ar1_errors, times_pairs
from poseppl.gaussians.walk_chains import WalkChains, ar1_chains, conjugate_gradients, walk_factor

T, WIDTH = 7, 2


@pytest.fixture(scope="module")
def chains() -> WalkChains:
    """Two coordinates that walk along their velocities, and three that last."""
    rng = np.random.default_rng(0)
    own, before, along, along_before = (rng.uniform(0.5, 2.0, (T, size)) for size in (4, 4, WIDTH, WIDTH))
    before[0], along_before[0] = 0.0, 0.0
    kept = rng.uniform(0.2, 0.9, T)
    return WalkChains(own, before, along, along_before, rng.normal(size=(T, 4))).beside(ar1_chains(kept, 2.0, 3))


def dense(chains: WalkChains) -> Floats:
    """F, a column for each coordinate of each frame."""
    size = chains.own.size
    each = np.moveaxis(np.eye(size).reshape(size, *chains.own.shape), 0, 1)
    return np.moveaxis(chains.innovations(each), 1, -1).reshape(size, size)


def test_innovations_are_those_of_the_walk(chains: WalkChains) -> None:
    x, frame = np.random.default_rng(1).normal(size=(T, 1, 7)), 3
    now, before = x[frame, 0], x[frame - 1, 0]
    walk = chains.own[frame, :2] * now[:2] - chains.before[frame, :2] * before[:2]
    walk += chains.along[frame] * now[2:4] - chains.along_before[frame] * before[2:4]
    alone = chains.own[frame, 2:] * now[2:] - chains.before[frame, 2:] * before[2:]
    np.testing.assert_allclose(chains.innovations(x)[frame, 0], [*walk, *alone])


def test_what_lasts_is_stationary() -> None:
    kept = np.array([0.3, 0.9, 0.5, 0.0])
    covariance = np.linalg.inv((root := dense(ar1_chains(kept, 2.0, 1))).T @ root)
    np.testing.assert_allclose(np.diag(covariance), 4.0)
    np.testing.assert_allclose(np.diag(covariance, 1), 4.0 * kept[1:])


@pytest.mark.parametrize("room", [0, 2**20])
def test_transposes_and_solutions_are_those_of_dense_matrices(chains: WalkChains, room: int) -> None:
    rng, root = np.random.default_rng(2), dense(chains)
    b = rng.normal(size=(T, 3, 7))

    def columns(x: Floats) -> Floats:
        return np.moveaxis(x, 1, -1).reshape(T * 7, -1)

    np.testing.assert_allclose(columns(chains.pulled(b)), root.T @ columns(b), atol=1e-12)
    information = (half := rng.normal(size=(T, 7, 2))) @ np.swapaxes(half, 1, 2)
    whole = root.T @ root
    for t, told in enumerate(information):
        whole[7 * t : 7 * t + 7, 7 * t : 7 * t + 7] += told
    inverse, factor = np.linalg.inv(whole), walk_factor(chains, information, room=room)
    assert (factor.gains is None) == (room == 0)
    np.testing.assert_allclose(columns(factor.solve(b)), inverse @ columns(b), rtol=1e-3, atol=1e-4)
    for t, covariance in factor.covariances():
        np.testing.assert_allclose(covariance, inverse[7 * t : 7 * t + 7, 7 * t : 7 * t + 7], rtol=1e-3, atol=1e-4)

    def multiply(x: Floats) -> Floats:
        return chains.pulled(chains.innovations(x)) + np.einsum("tij,tnj->tni", information, x)

    x, count = conjugate_gradients(multiply, walk_factor(chains, 0.3 * information), b, 1e-10)
    np.testing.assert_allclose(columns(x), inverse @ columns(b), rtol=1e-7, atol=1e-8)
    assert count < 30


def test_errors_that_last_are_marginalised() -> None:
    """P is the inverse of the covariance of both errors together; missing data count for nothing."""
    rng = np.random.default_rng(3)
    kept, ratio, half = rng.uniform(0.2, 0.9, T), 1.3, rng.normal(size=(2, T, 2, 2))
    weight = half @ np.swapaxes(half, -1, -2)
    weight[1, 4:6] = 0.0
    errors, z = ar1_errors(kept, ratio, weight), rng.normal(size=(5, 2, T, 2))
    chain = dense(ar1_chains(kept, 1.0, 1))
    lasting = np.kron(np.linalg.inv(chain.T @ chain), np.eye(2))
    for m in range(2):
        known = np.repeat(weight[m].any((1, 2)), 2)
        whole = np.zeros((2 * T, 2 * T))
        for t in np.flatnonzero(known[::2]):
            whole[2 * t : 2 * t + 2, 2 * t : 2 * t + 2] = np.linalg.inv(weight[m, t])
        precision = np.zeros_like(whole)
        precision[np.ix_(known, known)] = np.linalg.inv((whole + ratio**2 * lasting)[np.ix_(known, known)])
        np.testing.assert_allclose(errors.precision(z)[:, m].reshape(5, -1), z[:, m].reshape(5, -1) @ precision, atol=1e-8)
    np.testing.assert_allclose(errors.prior(z)[:, 0], np.einsum("ts,nsi->nti", chain.T @ chain, z[:, 0]), atol=1e-9)


def test_products_of_symmetric_matrices_with_pairs() -> None:
    rng = np.random.default_rng(4)
    half, z = rng.normal(size=(3, 4, 2, 2)), rng.normal(size=(2, 3, 4, 2))
    matrices = half + np.swapaxes(half, -1, -2)
    np.testing.assert_allclose(times_pairs(matrices, z), np.einsum("mtij,nmtj->nmti", matrices, z))
