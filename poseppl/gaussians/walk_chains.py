r"""The prior of trajectories whose coordinates walk alone, or along velocities: a block-tridiagonal precision of few numbers.

Innovations of x_t (n,), of which the first d coordinates p walk along the next d, their velocities v, are independent N(0, 1):

    own_t x_t - before_t x_(t-1) - offset_t,      and in the first d rows        + along_t v_t - along_before_t v_(t-1).

So a product with the precision F^T F costs O(T n), and the blocks B_t beside the diagonal are sparse. With information H_t
(n, n) of the data, S_t = H_t + (F^T F)_tt - B_t S_(t-1)^-1 B_t^T,

    (F^T F + H) x = r :    g_t = r_t - B_t S_(t-1)^-1 g_(t-1),    x_t = S_t^-1 (g_t - B_(t+1)^T x_(t+1)).

NumPy and LAPACK: nothing is compiled, and a frame costs one Cholesky inverse. Arrays of several columns are (T, N, n).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from poseppl.arrays import Floats

_ROOM = 2**28
"""Bytes of gains: some 3,400 frames of 140 coordinates."""


class WalkChains(NamedTuple):
    """The innovations of T frames, in units of their standard deviations.

    Attributes:
        own: Factor of a frame's coordinates (T, n).
        before: Factor of those of the frame before (T, n); 0 in the first row.
        along: Factor of the velocities (T, d).
        along_before: Factor of those of the frame before (T, d); 0 in the first row.
        offset: Their means (T, n).
    """

    own: NDArray[Any]
    before: NDArray[Any]
    along: NDArray[Any]
    along_before: NDArray[Any]
    offset: NDArray[Any]

    @property
    def _parts(self) -> tuple[slice, slice]:
        """Coordinates that walk along velocities, and these."""
        width = self.along.shape[1]
        return slice(0, width), slice(width, 2 * width)

    def beside(self, others: WalkChains) -> WalkChains:
        """The same with further coordinates (T, m), which walk alone."""
        pairs = zip((self.own, self.before, self.offset), (others.own, others.before, others.offset), strict=True)
        own, before, offset = (np.concatenate(pair, 1) for pair in pairs)
        return self._replace(own=own, before=before, offset=offset)

    def innovations(self, x: Floats) -> Floats:
        """F x (T, N, n), without the offset."""
        walk, pace = self._parts
        found = self.own[:, None] * x
        found[1:] -= self.before[1:, None] * x[:-1]
        found[..., walk] += self.along[:, None] * x[..., pace]
        found[1:, :, walk] -= self.along_before[1:, None] * x[:-1, :, pace]
        return found

    def pulled(self, w: Floats) -> Floats:
        """F^T w (T, N, n)."""
        walk, pace = self._parts
        found = self.own[:, None] * w
        found[:-1] -= self.before[1:, None] * w[1:]
        found[..., pace] += self.along[:, None] * w[..., walk]
        found[:-1, :, pace] -= self.along_before[1:, None] * w[1:, :, walk]
        return found

    def below(self, frame: int, rows: NDArray[Any]) -> NDArray[Any]:
        """B_t r for rows r (..., n) of the frame before."""
        walk, pace = self._parts
        found: NDArray[Any] = (-self.own[frame] * self.before[frame]) * rows
        moved = self.before[frame, walk] * rows[..., walk] + self.along_before[frame] * rows[..., pace]
        found[..., walk] = -self.own[frame, walk] * moved
        found[..., pace] -= self.along[frame] * moved
        return found

    def above(self, frame: int, rows: NDArray[Any]) -> NDArray[Any]:
        """B_t^T r for rows r (..., n) of the frame."""
        walk, pace = self._parts
        found: NDArray[Any] = (-self.own[frame] * self.before[frame]) * rows
        moved = self.own[frame, walk] * rows[..., walk] + self.along[frame] * rows[..., pace]
        found[..., walk] = -self.before[frame, walk] * moved
        found[..., pace] -= self.along_before[frame] * moved
        return found

    def diagonal_blocks(self) -> tuple[Floats, Floats]:
        """Blocks of F^T F on the diagonal: their own diagonals (T, n), and between coordinates and their velocities (T, d)."""
        walk, pace = self._parts
        own = self.own**2
        own[:-1] += self.before[1:] ** 2
        own[:, pace] += self.along**2
        own[:-1, pace] += self.along_before[1:] ** 2
        between = self.own[:, walk] * self.along
        between[:-1] += self.before[1:, walk] * self.along_before[1:]
        return own, between


def ar1_chains(kept: Floats, scale: Floats | float, width: int) -> WalkChains:
    """Stationary sequences x_t = kept_t x_(t-1) + ..., of a standard deviation, side by side.

    Args:
        kept: (T,); the first is not read.
        scale: Standard deviation, a number or (width,).
        width: How many.
    """
    left = np.concatenate([[0.0], np.asarray(kept, np.float64)[1:]])
    own = 1 / np.sqrt(1 - left**2)[:, None] / np.broadcast_to(scale, width)
    nothing = np.zeros((len(left), 0))
    return WalkChains(own, left[:, None] * own, nothing, nothing, np.zeros_like(own))


class WalkFactor(NamedTuple):
    """A precision F^T F + H, ready for solving; in float32, which is as good for a preconditioner.

    Attributes:
        chains: F.
        inverses: S_t^-1 (T, n, n).
        gains: (B_(t+1) S_t^-1)^T (T - 1, n, n); None where there is no room for them, and products with both take their place.
    """

    chains: WalkChains
    inverses: NDArray[np.float32]
    gains: NDArray[np.float32] | None

    def solve(self, r: Floats) -> Floats:
        """(F^T F + H)^-1 r for r (T, N, m), whose last n - m coordinates are 0, and are left out of the answer."""
        found = np.zeros((*r.shape[:2], self.inverses.shape[1]), np.float32)
        found[..., : r.shape[2]] = r
        for t in range(len(found) - 1):
            found[t + 1] -= self._carried(t, found[t])
        for t, inverse in enumerate(self.inverses):
            found[t] = found[t] @ inverse
        for t in range(len(found) - 2, -1, -1):
            found[t] -= self._brought_back(t, found[t + 1])
        return np.asarray(found[..., : r.shape[2]], np.float64)

    def _carried(self, frame: int, rows: NDArray[Any]) -> NDArray[Any]:
        """B_(t+1) S_t^-1 r for rows r (..., n)."""
        if self.gains is not None:
            return np.asarray(rows @ self.gains[frame])
        return self.chains.below(frame + 1, rows @ self.inverses[frame])

    def _brought_back(self, frame: int, rows: NDArray[Any]) -> NDArray[Any]:
        """S_t^-1 B_(t+1)^T r for rows r (..., n)."""
        if self.gains is not None:
            return np.asarray(rows @ self.gains[frame].T)
        return np.asarray(self.chains.above(frame + 1, rows) @ self.inverses[frame])

    def covariances(self) -> Iterator[tuple[int, Floats]]:
        """The frames and their covariances (n, n), from the last to the first."""
        following = np.asarray(self.inverses[-1], np.float64)
        yield len(self.inverses) - 1, following
        for t in range(len(self.inverses) - 2, -1, -1):
            following = self.inverses[t] + self._brought_back(t, self._brought_back(t, following).T)
            yield t, following


def walk_factor(chains: WalkChains, information: Iterable[Floats], *, room: int = _ROOM) -> WalkFactor:
    """Factorise F^T F + H.

    Args:
        chains: F, of n coordinates.
        information: H_t (n, n), frame by frame.
        room: Bytes of gains, which make solving faster; if they take more, there are none.

    Raises:
        numpy.linalg.LinAlgError: It is not positive definite.
    """
    (count, size), width = chains.own.shape, chains.along.shape[1]
    diagonal, between = chains.diagonal_blocks()
    inverses = np.empty((count, size, size), np.float32)
    gains = None if inverses.nbytes > room else np.empty((count - 1, size, size), np.float32)
    inverse, i, j = np.zeros((size, size)), np.arange(size), np.arange(width)
    for t, frame_block in enumerate(information):
        block = frame_block.copy()
        block[i, i] += diagonal[t]
        block[j, width + j] += between[t]
        block[width + j, j] += between[t]
        if t:
            gain = chains.below(t, inverse)
            if gains is not None:
                gains[t - 1] = gain
            block -= chains.below(t, gain.T)
        inverse = _inverse(block)
        inverses[t] = inverse
    return WalkFactor(WalkChains(*(np.asarray(part, np.float32) for part in chains)), inverses, gains)


def _inverse(matrix: Floats) -> Floats:
    """The inverse of a positive definite matrix (n, n)."""
    root, failed = lapack.dpotrf(matrix, lower=1, clean=1)
    lower, unsolved = lapack.dpotri(root, lower=1, overwrite_c=1)
    if failed or unsolved or not np.isfinite(lower[-1, -1]):
        raise np.linalg.LinAlgError("the precision of a trajectory is not positive definite")
    inverse: Floats = lower + lower.T
    np.einsum("ii->i", inverse)[:] /= 2
    return inverse


class ExpectedWalk(NamedTuple):
    """A trajectory given its data.

    Attributes:
        means: (T, n).
        squares: Expected squares of its innovations (T, n), less their offsets.
    """

    means: Floats
    squares: Floats


def expected_walk(chains: WalkChains, information: Iterable[Floats], vector: Floats) -> ExpectedWalk:
    """Smooth a trajectory whose data have the log-likelihood vector_t x_t - x_t H_t x_t / 2 in each frame.

    Args:
        chains: F, of n coordinates.
        information: H_t of the first m coordinates (m, m), frame by frame.
        vector: (T, m).

    Raises:
        numpy.linalg.LinAlgError: The precision is not positive definite.
    """
    (count, size), width = chains.own.shape, chains.along.shape[1]
    diagonal, between = chains.diagonal_blocks()
    inverses, gains = np.empty((count, size, size)), np.empty((count, size, size))
    right, i, j = chains.pulled(chains.offset[:, None])[:, 0], np.arange(size), np.arange(width)
    right[:, : vector.shape[1]] += vector
    for t, own in enumerate(information):
        block = np.zeros((size, size))
        block[: len(own), : len(own)] = own
        block[i, i] += diagonal[t]
        block[j, width + j] += between[t]
        block[width + j, j] += between[t]
        if t:
            gains[t - 1] = chains.below(t, inverses[t - 1])
            block -= chains.below(t, gains[t - 1].T)
            right[t] -= right[t - 1] @ gains[t - 1]
        inverses[t] = _inverse(block)
    means, covariance, across = _smoothed_back(inverses, gains, right)
    off = chains.innovations(means[:, None])[:, 0] - chains.offset
    return ExpectedWalk(means, off**2 + _innovation_variances(chains, covariance, across))


def _smoothed_back(inverses: Floats, gains: Floats, right: Floats) -> tuple[Floats, Floats, Floats]:
    """Means (T, n), covariances (T, n, n), and those of a frame, in rows, with the next one; the last of these is not set."""
    covariances, across = inverses, np.empty_like(gains)  # in the place of the inverses, which are read first
    means = np.empty_like(right)
    means[-1] = inverses[-1] @ right[-1]
    for t in range(len(means) - 2, -1, -1):
        gain = gains[t]
        means[t] = inverses[t] @ right[t] - gain @ means[t + 1]
        across[t] = -gain @ covariances[t + 1]
        covariances[t] -= across[t] @ gain.T
    return means, covariances, across


def _innovation_variances(chains: WalkChains, covariance: Floats, across: Floats) -> Floats:
    """Variances (T, n) of innovations, from covariances (T, n, n) of frames and those of each with the next one."""
    walk, pace = chains._parts
    own, before, along, along_before = chains.own, chains.before, chains.along, chains.along_before
    variance, beside = np.einsum("tii->ti", covariance), np.einsum("tii->ti", covariance[:, walk, pace])
    found: Floats = own**2 * variance
    found[:, walk] += along**2 * variance[:, pace] + 2 * own[:, walk] * along * beside
    if len(found) > 1:
        last = across[:-1]
        same = np.einsum("tii->ti", last)
        found[1:] += before[1:] ** 2 * variance[:-1] - 2 * own[1:] * before[1:] * same
        to_pace, from_pace = (np.einsum("tii->ti", part) for part in (last[:, walk, pace], last[:, pace, walk]))
        found[1:, walk] += along_before[1:] ** 2 * variance[:-1, pace] + 2 * before[1:, walk] * along_before[1:] * beside[:-1]
        found[1:, walk] -= 2 * own[1:, walk] * along_before[1:] * from_pace + 2 * before[1:, walk] * along[1:] * to_pace
        found[1:, walk] -= 2 * along[1:] * along_before[1:] * same[:, pace]
    return found


def conjugate_gradients(
    multiply: Callable[[Floats], Floats], factor: WalkFactor, b: Floats, tolerance: float, most: int = 50
) -> tuple[Floats, int]:
    """Solve A x = b for b (T, N, n), all columns together, by preconditioned conjugate gradients.

    Args:
        multiply: A, symmetric and positive definite.
        factor: The preconditioner's factor, of a matrix close to A.
        b: The right-hand sides.
        tolerance: Norm of the preconditioned residual at the end, relative to that of the preconditioned b.
        most: Iterations at most.

    Returns:
        x, and how many products with A were made.
    """

    def inner(a: Floats, b: Floats) -> Floats:
        return np.asarray(np.einsum("tni,tni->n", a, b))[:, None]

    x, r, z = np.zeros_like(b), b.copy(), factor.solve(b)
    direction, size = z, inner(b, z)
    goal, floor = tolerance**2 * size, np.finfo(np.float64).tiny
    count = 0
    while count < most:
        count += 1
        image = multiply(direction)
        length = size / np.maximum(inner(direction, image), floor)
        x += length * direction
        r -= length * image
        z = factor.solve(r)
        size, before = inner(r, z), size
        if np.all(size <= goal):
            break
        direction = z + size / np.maximum(before, floor) * direction
    return x, count
