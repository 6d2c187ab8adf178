r"""Gaussian conditionals replaced by linear ones, f(y | x) = N(A x + b, \Omega), where x ~ N(m, P).

With E[y | x] = h(x) and Cov[y | x] = R(x), by a first-order expansion at the mean,

    A = dh/dx (m),    A m + b = h(m),    \Omega = R(m),

or by statistical linear regression over sigma points x_j with weights w_j (Julier and Uhlmann 2004,
doi:10.1109/JPROC.2003.823141; \kappa = max(0, 3 - d), which for d >= 3 is the cubature rule of Arasaratnam and Haykin 2009,
doi:10.1109/TAC.2009.2019800):

    A m + b = E[h],    A = Cov[h, x] P^-1,    \Omega = Cov[h] - A P A^T + E[R],

or the same over a Gauss-Hermite grid of five points in each direction, exact for polynomials up to degree 9 (5^d points, for d
up to 6). The Gaussian that is linearised for need not be the one that is propagated: linearising for the posterior instead of
the prior, again and again, is posterior linearisation (Garcia-Fernandez, Svensson, Morelande and Sarkka 2015,
doi:10.1109/TSP.2015.2454485; first-order, the iterated extended Kalman filter).

For linear Gaussian programs all are exact. The Kalman filter and the Rauch-Tung-Striebel smoother below are those of Sarkka
and Svensson 2023 (Bayesian Filtering and Smoothing, 2nd edition, chapters 6 to 8, 12 and 14), in Joseph's form, or by the root
of the covariance where that is given.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.errors import UnsuitableModelError
from poseppl.gaussians.diffuse import DiffuseGaussian, condition_exactly, predict_exactly
from poseppl.gaussians.gaussian import (
    Gaussian,
    Linear as Linear,
    RootGaussian,
    lower_inverse,
    lower_root,
    semidefinite_root,
    triangular,
)

Moments = TypeVar("Moments", Gaussian, RootGaussian, DiffuseGaussian)
Method = Literal["first-order", "unscented", "gauss-hermite"]
_ORDER = 5
"""Points of the Gauss-Hermite rule in a direction."""
_MAX_DIRECTIONS = 6
Conditional = Callable[[Array], tuple[Array, Array]]
"""Mean and covariance of y given x."""


def first_order(conditional: Conditional, x: Array) -> Linear:
    """Linearise a conditional at a state (d,)."""

    def mean(x: Array) -> tuple[Array, tuple[Array, Array]]:
        moments = conditional(x)
        return moments[0], moments

    jacobian, (value, noise) = jax.jacrev(mean, has_aux=True)(x)
    return Linear(value, jacobian, noise)


def linearise(
    conditional: Conditional,
    x: Gaussian | RootGaussian | DiffuseGaussian,
    method: Method,
    jacobian_at: Callable[[Array], Array] | None = None,
) -> Linear:
    """Linearise a conditional for x ~ N(m, P), whose mean may have a known derivative (k, d)."""
    if method == "first-order":
        if jacobian_at is None:
            return first_order(conditional, x.mean)
        mean, noise = conditional(x.mean)
        return Linear(mean, jacobian_at(x.mean), noise)
    if isinstance(x, DiffuseGaussian):
        raise UnsuitableModelError("Sigma points need a variance in every direction. Use linearisation='first-order'.")
    white, weights = (jnp.asarray(part, x.mean.dtype) for part in _points(x.mean.shape[0], method))
    lower = lower_root(x)
    means, noises = jax.vmap(conditional)(x.mean + white @ lower.T)
    mean = weights @ means
    centred = means - mean
    white_jacobian = (centred * weights[:, None]).T @ white
    jacobian = white_jacobian @ lower_inverse(lower)
    noise = (centred * weights[:, None]).T @ centred - white_jacobian @ white_jacobian.T + jnp.tensordot(weights, noises, 1)
    return Linear(mean, jacobian, noise)


def linearise_about(
    conditional: Conditional,
    x: Gaussian | RootGaussian | DiffuseGaussian,
    about: Gaussian | RootGaussian | DiffuseGaussian,
    method: Method,
    jacobian_at: Callable[[Array], Array] | None = None,
) -> Linear:
    """Linearise a conditional for one Gaussian, and return the line in terms of another one, x."""
    linear = linearise(conditional, about, method, jacobian_at)
    return linear._replace(mean=linear.mean + linear.jacobian @ (x.mean - about.mean))


def _points(dimension: int, method: Method) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Points (n, d) and weights (n,) of a standard Gaussian.

    Raises:
        UnsuitableModelError: A Gauss-Hermite grid of too many directions.
    """
    if method == "gauss-hermite":
        if dimension > _MAX_DIRECTIONS:
            raise UnsuitableModelError(
                f"A Gauss-Hermite grid of {dimension} coordinates has {_ORDER}^{dimension} points. Expected at most "
                f"{_MAX_DIRECTIONS} coordinates; use unscented."
            )
        nodes, masses = np.polynomial.hermite_e.hermegauss(_ORDER)
        white = np.stack(np.meshgrid(*[nodes] * dimension, indexing="ij"), -1).reshape(-1, dimension)
        weights = np.stack(np.meshgrid(*[masses / masses.sum()] * dimension, indexing="ij"), -1).reshape(-1, dimension)
        return white, weights.prod(1)
    kappa = max(0.0, 3.0 - dimension)
    spread = np.sqrt(dimension + kappa) * np.eye(dimension)
    side = np.full(2 * dimension, 0.5 / (dimension + kappa))
    return np.concatenate([np.zeros((1, dimension)), spread, -spread]), np.append(kappa / (dimension + kappa), side)


def predict(x: Moments, linear: Linear) -> Moments:
    """Distribution of y."""
    if isinstance(x, DiffuseGaussian):
        return predict_exactly(x, linear)
    if isinstance(x, RootGaussian):
        return RootGaussian(linear.mean, triangular(jnp.hstack([linear.jacobian @ x.scale, semidefinite_root(linear.noise)])))
    return Gaussian(linear.mean, _symmetric(linear.jacobian @ x.covariance @ linear.jacobian.T + linear.noise))


def condition(x: Moments, linear: Linear, y: Array, seen: Array) -> tuple[Moments, Array]:
    """Distribution of x given the seen entries of y.

    Args:
        x: The prior.
        linear: The conditional of y.
        y: Data (k,).
        seen: Booleans (k,).

    Returns:
        The posterior, and the log-density of the seen data, a scalar.
    """
    if isinstance(x, DiffuseGaussian):
        return condition_exactly(x, linear, y, seen)
    jacobian = jnp.where(seen[:, None], linear.jacobian, 0.0)
    both = seen[:, None] & seen
    noise = jnp.where(both, linear.noise, jnp.eye(y.shape[0], dtype=y.dtype))
    residual = jnp.where(seen, y - linear.mean, 0.0)
    if isinstance(x, RootGaussian):
        return _condition_root(x, jacobian, noise, residual, seen)
    factor = jnp.linalg.cholesky(jacobian @ x.covariance @ jacobian.T + noise)
    whiten = lower_inverse(factor)
    gain = (whiten @ jacobian @ x.covariance).T @ whiten
    kept = jnp.eye(x.mean.shape[0], dtype=y.dtype) - gain @ jacobian
    covariance = _symmetric(kept @ x.covariance @ kept.T + gain @ noise @ gain.T)
    return Gaussian(x.mean + gain @ residual, covariance), _log_density(whiten @ residual, factor, seen)


def _condition_root(x: RootGaussian, jacobian: Array, noise: Array, residual: Array, seen: Array) -> tuple[RootGaussian, Array]:
    """The same by one triangular factor, of the joint covariance of y and x: [[F, 0], [G, S]] with S the posterior's scale."""
    count, dimension = jacobian.shape
    data = jnp.hstack([jacobian @ x.scale, semidefinite_root(noise)])
    joint = triangular(jnp.vstack([data, jnp.hstack([x.scale, jnp.zeros((dimension, count), x.scale.dtype)])]))
    factor = joint[:count, :count]
    white = lower_inverse(factor) @ residual
    return RootGaussian(x.mean + joint[count:, :count] @ white, joint[count:, count:]), _log_density(white, factor, seen)


def _log_density(white: Array, factor: Array, seen: Array) -> Array:
    """Log-density of whitened residuals (k,), of which some were seen."""
    return -0.5 * (jnp.sum(white**2) + jnp.sum(seen) * jnp.log(2 * jnp.pi)) - jnp.sum(jnp.log(jnp.diagonal(factor)))


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2
