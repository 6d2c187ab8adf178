r"""Proposals of Particle-aGRAD and Particle-mGRAD for one frame, and the terms of their weights.

Corenflos and Finke 2024 (https://arxiv.org/abs/2401.14868). Around the reference x' an auxiliary variable is drawn,

    u ~ N(phi(x'), h S),    phi(x) = x + h S grad log g(x),    h = delta / 2,

and particles are proposed by q(x | m, u) ~ N(x; m, Q) N(u; x, h S), m being the mean of the transition from the particle's
ancestor. In coordinates y = W x in which S is the identity and Q = diag(lambda), with a = lambda / (lambda + h),

    q = N(y; (1 - a) m + a u, a h).

Let f be the density of the transition and g the likelihood. Slot n could have been the reference with density proportional to

    w^n = f(x^n) g(x^n) N(u; phi^n, h) / q(x^n | m^n, u)                               (aGRAD: u is kept)
    w^n = f(x^n) g(x^n) integral of N(u; phi^n, h) prod_(k != n) q(x^k | m^k, u) du      (mGRAD: u is integrated out)

because it comes with the proposals of the other slots; what does not depend on n cancels. With e = y - (1 - a) m,
the logarithms of the last factors are, summed over coordinates,

    -(u - phi^n)^2 / 2h + (e^n - a u)^2 / 2ah
    -(phi^n)^2 / 2h + (e^n)^2 / 2ah + (phi^n + sum_(k != n) e^k)^2 / (2h (1 + (N - 1) a)).

Since f stands in the weight, any fixed Q, S and phi leave the posterior invariant; those near the transition's are good.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

Variant = Literal["mgrad", "agrad"]
Scaling = Literal["covariance", "spread", "none"]


class Geometry(NamedTuple):
    """Coordinates y = W x of a frame in which S is the identity and Q diagonal.

    Attributes:
        whiten: W (d, d).
        colour: Its inverse (d, d).
        variances: The diagonal lambda of Q in y (d,).
    """

    whiten: Array
    colour: Array
    variances: Array


def geometry(scale: Array, noise: Array) -> Geometry:
    """The coordinates for a scale S and the noise Q of the transition, both (d, d)."""
    factor = jnp.linalg.cholesky(scale)
    inverse = jax.scipy.linalg.solve_triangular(factor, jnp.eye(len(scale), dtype=scale.dtype), lower=True)
    variances, axes = jnp.linalg.eigh(inverse @ noise @ inverse.T)
    floor = float(np.finfo(scale.dtype).eps) * variances[-1]
    return Geometry(axes.T @ inverse, factor @ axes, jnp.maximum(variances, floor))


def scale_of(scaling: Scaling, particles: Array, log_weights: Array) -> Array:
    """S (d, d) of a frame, of the filter's particles (N, d): their covariance, its diagonal, or the identity."""
    dimension = particles.shape[1]
    identity = jnp.eye(dimension, dtype=particles.dtype)
    if scaling == "none":
        return identity
    weights = jax.nn.softmax(log_weights)
    centred = particles - weights @ particles
    spread = jnp.sum(weights[:, None] * centred**2, 0)
    spread = jnp.where(spread > 0, spread, jnp.where(jnp.any(spread > 0), jnp.max(spread) * 1e-6, 1.0))
    shrinkage = 1.0 if scaling == "spread" else 0.1
    return (1 - shrinkage) * (centred.T * weights) @ centred + shrinkage * jnp.diag(spread)


def propose(rng_key: Array, axes: Geometry, h: Array, u: Array, means: Array) -> Array:
    """Draw states (N, d) from q, given u (d,) in y and means (N, d) in x."""
    a = axes.variances / (axes.variances + h)
    centres = (1 - a) * (means @ axes.whiten.T) + a * u
    noise = jax.random.normal(rng_key, means.shape, means.dtype)
    return (centres + jnp.sqrt(a * h) * noise) @ axes.colour.T


def shifted(axes: Geometry, h: Array, xs: Array, gradients: Array) -> Array:
    """Give phi (..., d) in y, of states and gradients (..., d) in x; where a gradient is not finite it counts as zero."""
    finite = jnp.all(jnp.isfinite(gradients), -1, keepdims=True)
    return xs @ axes.whiten.T + h * (jnp.where(finite, gradients, 0.0) @ axes.colour)


def log_correction(variant: Variant, axes: Geometry, h: Array, u: Array, xs: Array, means: Array, phi: Array) -> Array:
    """The last factor of the weights (N,), in logarithms, of states and means (N, d) in x, u (d,) and phi (N, d) in y."""
    a = axes.variances / (axes.variances + h)
    whitened = xs @ axes.whiten.T
    centre = jnp.mean(whitened, 0)  # of all, so that small differences are not lost in large numbers
    e = whitened - centre - (1 - a) * (means @ axes.whiten.T - centre)
    phi, u = phi - centre, u - centre
    if variant == "agrad":
        return jnp.sum(-((u - phi) ** 2) + (e - a * u) ** 2 / a, -1) / (2 * h)
    others = phi + jnp.sum(e, 0) - e
    return jnp.sum(-(phi**2) + e**2 / a + others**2 / (1 + (len(xs) - 1) * a), -1) / (2 * h)
