r"""Kalman filtering and Rauch-Tung-Striebel smoothing of linear Gaussians in O(log T) parallel steps.

Both passes are prefix sums of an associative operation (Sarkka and Garcia-Fernandez 2021, doi:10.1109/TAC.2020.2976316). With
x_t = F x_(t-1) + u + q, q ~ N(0, Q), and z_t = H x_t + r, r ~ N(0, R), a frame of the filter is

    f(x_t | z_t, x_(t-1)) = N(A x_(t-1) + b, C),     p(z_t | x_(t-1)) \propto exp(\eta^T x_(t-1) - x_(t-1)^T J x_(t-1) / 2),

and one of the smoother N(E x_(t+1) + g, L). They take more operations than the sequential passes, and pay on a GPU.

>>> one, zero = jnp.ones((3, 1, 1)), jnp.zeros((3, 1))
>>> transitions, data = LinearFrames(one, zero, one), LinearFrames(one, zero, one)
>>> found = filter_in_parallel(zero[0], one[0], transitions, data, jnp.array([[1.0], [2.0], [3.0]]))
>>> [round(float(mean), 3) for mean in found.mean[:, 0]]
[0.5, 1.4, 2.385]
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.gaussians.gaussian import Gaussian


class LinearFrames(NamedTuple):
    """Linear conditionals y = jacobian x + offset + noise of T frames: (T, k, d), (T, k), covariances (T, k, k)."""

    jacobian: Array
    offset: Array
    noise: Array


class _Filtering(NamedTuple):
    """An element of the filter: A (d, d), b (d,), C (d, d), eta (d,), J (d, d), as the module's head has them."""

    A: Array
    b: Array
    C: Array
    eta: Array
    J: Array


class _Smoothing(NamedTuple):
    """An element of the smoother: E (d, d), g (d,), L (d, d)."""

    E: Array
    g: Array
    L: Array


def filter_in_parallel(
    mean: Array, covariance: Array, transitions: LinearFrames, observations: LinearFrames, data: Array
) -> Gaussian:
    """The filtered Gaussians, means (T, d) and covariances (T, d, d).

    Args:
        mean: Mean of the first frame's state (d,), before its data.
        covariance: Its covariance (d, d).
        transitions: Into each frame; the first one is not used.
        observations: Linear observations of each frame. An entry without data has a zero row of the jacobian, and any
        positive noise of its own.
        data: (T, k).
    """
    moved = transitions._replace(
        jacobian=transitions.jacobian.at[0].set(0.0),
        offset=transitions.offset.at[0].set(mean),
        noise=transitions.noise.at[0].set(covariance),
    )
    elements = jax.vmap(_filtering)(moved, observations, data)
    _, b, C, _, _ = jax.lax.associative_scan(jax.vmap(_join_filtering), elements)
    return Gaussian(b, C)


def smooth_in_parallel(filtered: Gaussian, predicted: Array, gains: Array, left: Array) -> Gaussian:
    """The smoothed Gaussians of a forward pass.

    Args:
        filtered: Means (T, d) and covariances (T, d, d).
        predicted: Means (T, d) of the predictions.
        gains: Matrices (T, d, d) from each frame to the one before; the first one is not used.
        left: Covariances (T, d, d) of the frame before given each frame; the first one is not used.
    """
    E = jnp.concatenate([gains[1:], jnp.zeros_like(gains[:1])])
    g = filtered.mean - jnp.einsum("tij,tj->ti", E, jnp.roll(predicted, -1, 0))
    L = jnp.concatenate([left[1:], filtered.covariance[-1:]])
    _, mean, covariance = jax.lax.associative_scan(jax.vmap(_join_smoothing), _Smoothing(E, g, L), reverse=True)
    return Gaussian(mean, covariance)


def _filtering(moved: LinearFrames, seen: LinearFrames, data: Array) -> _Filtering:
    """One frame: the transition into it, its observation and its data."""
    F, u, Q = moved
    H, offset, R = seen
    weighted = jnp.linalg.solve(H @ Q @ H.T + R, jnp.hstack([H, (data - offset - H @ u)[:, None]]))
    gain, apart = Q @ weighted[:, :-1].T, weighted[:, -1]
    kept = jnp.eye(len(u), dtype=u.dtype) - gain @ H
    back = F.T @ H.T
    return _Filtering(kept @ F, u + Q @ H.T @ apart, _symmetric(kept @ Q), back @ apart, back @ weighted[:, :-1] @ F)


def _join_filtering(first: _Filtering, second: _Filtering) -> _Filtering:
    one = jnp.eye(len(first.b), dtype=first.b.dtype)
    forth = second.A @ jnp.linalg.inv(one + first.C @ second.J)
    back = first.A.T @ jnp.linalg.inv(one + second.J @ first.C)
    return _Filtering(
        A=forth @ first.A,
        b=forth @ (first.b + first.C @ second.eta) + second.b,
        C=_symmetric(forth @ first.C @ second.A.T + second.C),
        eta=back @ (second.eta - second.J @ first.b) + first.eta,
        J=_symmetric(back @ second.J @ first.A + first.J),
    )


def _join_smoothing(later: _Smoothing, earlier: _Smoothing) -> _Smoothing:
    """In this order, as a reversed scan gives the later frames first."""
    return _Smoothing(
        E=earlier.E @ later.E,
        g=earlier.E @ later.g + earlier.g,
        L=_symmetric(earlier.E @ later.L @ earlier.E.T + earlier.L),
    )


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2
