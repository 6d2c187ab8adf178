r"""Gaussian conditionals replaced by linear ones, f(y | x) = N(A x + b, \Omega), where x ~ N(m, P).

With E[y | x] = h(x) and Cov[y | x] = R(x), by a first-order expansion at the mean,

    A = dh/dx (m),    A m + b = h(m),    \Omega = R(m),

or by statistical linear regression over sigma points x_j with weights w_j (Julier and Uhlmann 2004,
doi:10.1109/JPROC.2003.823141; \kappa = max(0, 3 - d), which for d >= 3 is the cubature rule of Arasaratnam and Haykin 2009,
doi:10.1109/TAC.2009.2019800):

    A m + b = E[h],    A = Cov[h, x] P^-1,    \Omega = Cov[h] - A P A^T + E[R].

For linear Gaussian programs both are exact. The Kalman filter and the Rauch-Tung-Striebel smoother below are those of Sarkka
and Svensson 2023 (Bayesian Filtering and Smoothing, 2nd edition, chapters 6 to 8, 12 and 14), in Joseph's form.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import Array
from jax.scipy.linalg import cho_factor, cho_solve, solve_triangular

from poseppl.gaussians.gaussian import Gaussian

Method = Literal["first-order", "unscented"]
Conditional = Callable[[Array], tuple[Array, Array]]
"""Mean and covariance of y given x."""


class Linear(NamedTuple):
    """A linear conditional: mean (k,) of y at the mean of x, jacobian (k, d) and noise covariance (k, k)."""

    mean: Array
    jacobian: Array
    noise: Array


def first_order(conditional: Conditional, x: Array) -> Linear:
    """Linearise a conditional at a state (d,)."""

    def mean(x: Array) -> tuple[Array, tuple[Array, Array]]:
        moments = conditional(x)
        return moments[0], moments

    jacobian, (value, noise) = jax.jacrev(mean, has_aux=True)(x)
    return Linear(value, jacobian, noise)


def linearise(
    conditional: Conditional, x: Gaussian, method: Method, jacobian_at: Callable[[Array], Array] | None = None
) -> Linear:
    """Linearise a conditional for x ~ N(m, P), whose mean may have a known derivative (k, d)."""
    if method == "first-order":
        if jacobian_at is None:
            return first_order(conditional, x.mean)
        mean, noise = conditional(x.mean)
        return Linear(mean, jacobian_at(x.mean), noise)
    dimension = x.mean.shape[0]
    kappa = max(0.0, 3.0 - dimension)
    spread = jnp.sqrt(jnp.asarray(dimension + kappa, x.mean.dtype)) * jnp.eye(dimension, dtype=x.mean.dtype)
    white = jnp.concatenate([jnp.zeros((1, dimension), x.mean.dtype), spread, -spread])
    side = jnp.full(2 * dimension, 0.5 / (dimension + kappa), x.mean.dtype)
    weights = jnp.concatenate([jnp.full(1, kappa / (dimension + kappa), x.mean.dtype), side])
    lower = jnp.linalg.cholesky(x.covariance)
    means, noises = jax.vmap(conditional)(x.mean + white @ lower.T)
    mean = weights @ means
    centred = means - mean
    white_jacobian = (centred * weights[:, None]).T @ white
    jacobian = solve_triangular(lower.T, white_jacobian.T, lower=False).T
    noise = (centred * weights[:, None]).T @ centred - white_jacobian @ white_jacobian.T + jnp.tensordot(weights, noises, 1)
    return Linear(mean, jacobian, noise)


def predict(x: Gaussian, linear: Linear) -> Gaussian:
    """Distribution of y."""
    return Gaussian(linear.mean, _symmetric(linear.jacobian @ x.covariance @ linear.jacobian.T + linear.noise))


def condition(x: Gaussian, linear: Linear, y: Array, seen: Array) -> tuple[Gaussian, Array]:
    """Distribution of x given the seen entries of y.

    Args:
        x: The prior.
        linear: The conditional of y.
        y: Data (k,).
        seen: Booleans (k,).

    Returns:
        The posterior, and the log-density of the seen data, a scalar.
    """
    jacobian = jnp.where(seen[:, None], linear.jacobian, 0.0)
    both = seen[:, None] & seen
    noise = jnp.where(both, linear.noise, jnp.eye(y.shape[0], dtype=y.dtype))
    residual = jnp.where(seen, y - linear.mean, 0.0)
    factor = cho_factor(jacobian @ x.covariance @ jacobian.T + noise, lower=True)
    gain = cho_solve(factor, jacobian @ x.covariance).T
    kept = jnp.eye(x.mean.shape[0], dtype=y.dtype) - gain @ jacobian
    covariance = _symmetric(kept @ x.covariance @ kept.T + gain @ noise @ gain.T)
    log_density = -0.5 * (residual @ cho_solve(factor, residual) + jnp.sum(seen) * jnp.log(2 * jnp.pi))
    log_density = log_density - jnp.sum(jnp.log(jnp.diagonal(factor[0])))
    return Gaussian(x.mean + gain @ residual, covariance), log_density


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2
