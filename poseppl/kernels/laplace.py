"""The local geometry of a posterior: its mode by Gauss-Newton, and coordinates in which it is round.

For a Gaussian prior with precision P around m, and a likelihood with Gauss-Newton curvature I(x) (the Fisher information),
one step from x goes to the mode of the local quadratic model,

    x + (P + I(x))^-1 (grad log p(z | x) - P (x - m)).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

_DAMPING = (0.0, 1.0, 0.3, 0.1, 0.01)
"""Fractions of a Gauss-Newton step that are tried; the best is taken, so that the density never falls."""

GAUSS_NEWTON_TRIALS = len(_DAMPING)
"""Densities that a Gauss-Newton step evaluates."""


class Whitening(NamedTuple):
    """An affine chart x = centre + scale z in which a density is roughly a standard normal.

    Attributes:
        centre: Shape (d,).
        scale: Upper triangular (d, d), or (d,) for a diagonal one.
    """

    centre: jax.Array
    scale: jax.Array

    def to_state(self, z: jax.Array) -> jax.Array:
        """Map whitened coordinates (..., d) to the state."""
        return self.centre + (z * self.scale if self.scale.ndim == 1 else z @ self.scale.T)

    def to_white(self, x: jax.Array) -> jax.Array:
        """Map states (N, d) to whitened coordinates."""
        offset = x - self.centre
        return offset / self.scale if self.scale.ndim == 1 else solve_triangular(self.scale, offset.T, lower=False).T


def whitening(centre: jax.Array, precision: jax.Array, *, dense: bool = True) -> Whitening:
    """Whiten by a precision matrix.

    Args:
        centre: Shape (d,).
        precision: Symmetric positive definite (d, d).
        dense: False uses the diagonal alone: the step sizes per coordinate of Choo and Fleet 2001, Eq. 17.
    """
    if not dense:
        return Whitening(centre, 1.0 / jnp.sqrt(jnp.diagonal(precision)))
    # scaled to a unit diagonal first: millimetres and radians side by side cost float32 its digits
    unit = 1.0 / jnp.sqrt(jnp.diagonal(precision))
    lower = jnp.linalg.cholesky(precision * unit[:, None] * unit)
    inverse = solve_triangular(lower, jnp.eye(lower.shape[0], dtype=lower.dtype), lower=True)
    return Whitening(centre, unit[:, None] * inverse.T)


class Modes(NamedTuple):
    """Local modes and their Laplace approximations.

    Attributes:
        states: Shape (S, d).
        precisions: Curvatures of the negative log-density there (S, d, d).
        scales: Their inverse square roots (S, d, d), upper triangular.
        log_masses: Laplace's integral of the density around each, (S,): log p + d/2 log 2 pi - 1/2 log |precision|.
    """

    states: jax.Array
    precisions: jax.Array
    scales: jax.Array
    log_masses: jax.Array


def find_modes(
    starts: jax.Array,
    prior_precisions: jax.Array,
    log_density: Callable[[jax.Array], jax.Array],
    information: Callable[[jax.Array], jax.Array],
    num_steps: int,
) -> Modes:
    """Climb from many starts by damped Gauss-Newton, side by side.

    Args:
        starts: Shape (S, d).
        prior_precisions: P for each start (S, d, d).
        log_density: Unnormalised log posterior density of one state, a scalar.
        information: Gauss-Newton curvature (d, d) of the negative log-likelihood at one state.
        num_steps: How many steps; each is damped, or left out, so that the density never falls.
    """
    gradient = jax.grad(log_density)
    damping = jnp.array(_DAMPING, starts.dtype)

    def climb(x: jax.Array, prior_precision: jax.Array) -> jax.Array:
        chart = whitening(x, prior_precision + information(x))
        trials = x + damping[:, None] * (chart.scale @ (chart.scale.T @ gradient(x)))
        values = jax.vmap(log_density)(trials)
        best = trials[jnp.argmax(jnp.where(jnp.isnan(values), -jnp.inf, values))]
        return jnp.where(jnp.all(jnp.isfinite(best)), best, x)

    def step(states: jax.Array, _: None) -> tuple[jax.Array, None]:
        return jax.vmap(climb)(states, prior_precisions), None

    def describe(x: jax.Array, prior_precision: jax.Array) -> Modes:
        precision = prior_precision + information(x)
        scale = whitening(x, precision).scale
        volume = jnp.sum(jnp.log(jnp.diagonal(scale))) + 0.5 * x.shape[0] * jnp.log(2 * jnp.pi)
        mass = log_density(x) + volume
        return Modes(x, precision, scale, jnp.where(jnp.isnan(mass), -jnp.inf, mass))

    states, _ = jax.lax.scan(step, starts, None, length=num_steps)
    return jax.vmap(describe)(states, prior_precisions)
