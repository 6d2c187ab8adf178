"""Laplace's approximation at modes on the face of active constraints: the side that is cut off has no mass.

Let x be a mode of the cost f, with the gradient g and the curvature H = S^-1. Let t >= 0 be the distances from the active
constraints, t = -N dx with outward normals N, and s >= 0 their multipliers, -g = N^T s. Then

    p(x + dx) ~ exp(-f - s^T t - dx^T H dx / 2),

a Gaussian on the free face, of covariance S - S N^T K N S with K = (N S N^T)^-1, times an exponential density with a Gaussian
factor of precision K in t. Its mass is that of the Gaussian without constraints, times

    |K|^(1/2) (2 pi)^(-a/2) integral over t >= 0 of exp(-s^T t - t^T K t / 2),

for one active constraint Mills' ratio; for several the product of the single ones times
exp(-sum over i < j of K_ij E[t_i] E[t_j]), by Jensen's inequality a lower bound. Constraints that are near, but not active, cut
off their own share of the Gaussian on the face, each by itself. A slope that vanishes leaves one half, from either side.

The density exp(-s t - c t^2 / 2) on t >= 0 is a Gaussian cut off on the slope, in the limit c -> 0 an exponential. With z = s
/ sqrt(c) and Mills' ratio R(z) = (1 - Phi(z)) / phi(z), its integral is R(z) / sqrt(c), its mean (1 / R(z) - z) / sqrt(c). The
ratio is computed from the normal's tail below z = 3, and from Laplace's continued fraction z + 1 / (z + 2 / (z + 3 / ...))
above, so that nothing cancels however steep the slope is.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.scipy.linalg import cho_factor, cho_solve
from jax.scipy.special import log_ndtr

from poseppl.kernels.constraints import Constraints
from poseppl.kernels.laplace import whitening
from poseppl.kernels.trust_region import OptimizationResult, active_face
from poseppl.particles.weights import nan_to_neg_inf

_FLOOR = 1e-6
"""Least eigenvalue of a curvature that is scaled to a unit diagonal: what is flatter counts as this flat."""


class FaceModes(NamedTuple):
    """Modes under constraints; the first four fields are those of :class:`~poseppl.kernels.laplace.Modes`.

    Attributes:
        states: Shape (S, d).
        precisions: Curvatures (S, d, d), with the square of the slope across active constraints: the coordinates that
            distinguish modes.
        scales: Their inverse square roots (S, d, d), upper triangular.
        log_masses: Masses of the cut Gaussians (S,), -inf where a climb has no finite cost.
        covariances: On the free face (S, d, d), of rank d less the number of active constraints.
        active: Active constraints (S, d + m), in the order of `Constraints.normals`.
        slopes: Their multipliers (S, d + m).
        inner_curvatures: Curvatures of the density in t (S, d + m), 1 where a constraint is not active.
        inward: How a state moves with t (S, d, d + m), 0 where a constraint is not active.
    """

    states: Array
    precisions: Array
    scales: Array
    log_masses: Array
    covariances: Array
    active: Array
    slopes: Array
    inner_curvatures: Array
    inward: Array

    def moments(self) -> tuple[Array, Array]:
        """Means (S, d) and covariances (S, d, d): those of the face, moved and widened by what lies inside of it."""
        mean, variance = moments(self.slopes, self.inner_curvatures)
        means = self.states + jnp.einsum("sdn,sn->sd", self.inward, jnp.where(self.active, mean, 0.0))
        inside = jnp.einsum("sdn,sn,sen->sde", self.inward, jnp.where(self.active, variance, 0.0), self.inward)
        return means, self.covariances + inside


def face_modes(climbs: OptimizationResult, constraints: Constraints) -> FaceModes:
    """Describe where climbs (S, ...) have come to."""
    return jax.vmap(lambda climb: _describe(climb, constraints))(climbs)


def _describe(climb: OptimizationResult, constraints: Constraints) -> FaceModes:
    x, dimension = climb.states, climb.states.shape[0]
    precision, covariance, log_det = _positive(climb.curvatures)
    multipliers = active_face(x, climb.gradients, precision, constraints).multipliers
    active, normals = multipliers > 0, constraints.normals(x)
    outward = normals * active[:, None]
    crossed = outward @ covariance
    # Schur's complement, scaled to a unit diagonal; constraints that are not active stand for themselves
    inner, inner_log_det = _inverse(crossed @ outward.T + jnp.diag(1.0 - active))
    inward = -(crossed.T @ inner)
    face = covariance - crossed.T @ inner @ crossed
    curvatures = jnp.diagonal(inner)
    means = jnp.where(active, moments(multipliers, curvatures)[0], 0.0)
    pairs = means @ (inner - jnp.diag(curvatures)) @ means
    cut = jnp.where(active, log_integral(multipliers, curvatures) - 0.5 * jnp.log(2 * jnp.pi), 0.0)
    mass = -climb.costs + 0.5 * (dimension * jnp.log(2 * jnp.pi) - log_det + inner_log_det - pairs) + jnp.sum(cut)
    mass = mass + _kept_by_others(x, face, active, constraints)
    steep = precision + (outward * (multipliers**2)[:, None]).T @ outward
    return FaceModes(
        states=x,
        precisions=steep,
        scales=whitening(x, steep).scale,
        log_masses=nan_to_neg_inf(mass),
        covariances=0.5 * (face + face.T),
        active=active,
        slopes=multipliers,
        inner_curvatures=curvatures,
        inward=inward,
    )


def _kept_by_others(x: Array, covariance: Array, active: Array, constraints: Constraints) -> Array:
    """Logarithm of the share of the Gaussian on the face that other constraints leave: of two bounds the nearer."""
    normals = constraints.normals(x)
    spread = jnp.sqrt(jnp.maximum(jnp.einsum("ni,ij,nj->n", normals, covariance, normals), 0.0))
    slack = jnp.maximum(constraints.slacks(x), 0.0)
    near = ~active & jnp.isfinite(slack) & (spread > 0)
    distance = jnp.where(near, slack, 0.0) / jnp.where(near, spread, 1.0)
    return jnp.sum(jnp.where(near, log_ndtr(distance), 0.0))


def _positive(matrix: Array) -> tuple[Array, Array, Array]:
    """A symmetric matrix made positive definite, its inverse and its log-determinant."""
    diagonal = jnp.abs(jnp.diagonal(matrix))
    largest = jnp.max(diagonal)
    diagonal = jnp.where(largest > 0, jnp.maximum(diagonal, _FLOOR * largest), 1.0)
    unit = jax.lax.rsqrt(diagonal)
    values, vectors = jnp.linalg.eigh(matrix * unit[:, None] * unit)
    values = jnp.maximum(values, _FLOOR)
    whole = (vectors * values) @ vectors.T / unit[:, None] / unit
    inverse = (vectors / values) @ vectors.T * unit[:, None] * unit
    return whole, inverse, jnp.sum(jnp.log(values)) + jnp.sum(jnp.log(diagonal))


def _inverse(matrix: Array) -> tuple[Array, Array]:
    """The inverse of a positive semi-definite matrix, and the inverse's log-determinant."""
    unit = jax.lax.rsqrt(jnp.maximum(jnp.diagonal(matrix), np.finfo(matrix.dtype).tiny))
    eye = jnp.eye(len(matrix), dtype=matrix.dtype)
    # constraints that say the same share their slope
    factor = cho_factor(matrix * unit[:, None] * unit + 32 * np.finfo(matrix.dtype).eps * eye, lower=True)
    inverse = cho_solve(factor, eye) * unit[:, None] * unit
    return inverse, -2.0 * jnp.sum(jnp.log(jnp.diagonal(factor[0]))) + 2.0 * jnp.sum(jnp.log(unit))


_FRACTION_FROM, _LEVELS, _NEWTON_STEPS = 3.0, 30, 5


def log_integral(slope: Array, curvature: Array) -> Array:
    """Logarithm of the integral over t >= 0; slope >= 0 and curvature > 0 of any one shape."""
    return log_mills(slope / jnp.sqrt(curvature)) - 0.5 * jnp.log(curvature)


def moments(slope: Array, curvature: Array) -> tuple[Array, Array]:
    """Mean and variance."""
    z, scale = slope / jnp.sqrt(curvature), 1.0 / jnp.sqrt(curvature)
    far, (near, behind) = z > _FRACTION_FROM, _fraction(jnp.maximum(z, _FRACTION_FROM))
    hazard = jnp.exp(-log_mills(jnp.minimum(z, _FRACTION_FROM)))
    excess = jnp.where(far, near, hazard - z)
    variance = jnp.where(far, near * (behind - near), 1.0 - hazard * (hazard - z))
    return scale * excess, scale**2 * variance


def draw(rng_key: Array, slope: Array, curvature: Array, num_draws: int) -> Array:
    """Draws (N, ...), by the inverse of the distribution function: Newton's method on the logarithm of the tail."""
    z = slope / jnp.sqrt(curvature)
    target = jax.random.exponential(rng_key, (num_draws, *z.shape), z.dtype)
    start = jnp.sqrt(z * z + 2.0 * target) - z

    def improve(_: int, t: Array) -> Array:
        tail = z * t + 0.5 * t * t - log_mills(z + t) + log_mills(z)
        return jnp.maximum(t - (tail - target) * jnp.exp(log_mills(z + t)), 0.0)

    draws: Array = jax.lax.fori_loop(0, _NEWTON_STEPS, improve, start) / jnp.sqrt(curvature)
    return draws


def log_mills(z: Array) -> Array:
    """Logarithm of Mills' ratio (1 - Phi(z)) / phi(z)."""
    near = jnp.minimum(z, _FRACTION_FROM)
    direct = log_ndtr(-near) + 0.5 * near * near + 0.5 * jnp.log(2 * jnp.pi)
    far = jnp.maximum(z, _FRACTION_FROM)
    return jnp.where(z > _FRACTION_FROM, -jnp.log(far + _fraction(far)[0]), direct)


def _fraction(z: Array) -> tuple[Array, Array]:
    """1 / (z + r) and r, with r = 2 / (z + 3 / (z + ...)): what Mills' ratio adds to z, and what stands below."""
    tail = jax.lax.fori_loop(0, _LEVELS - 1, lambda turn, tail: (_LEVELS - turn) / (z + tail), jnp.zeros_like(z))
    return 1.0 / (z + tail), tail
