r"""The density exp(-s t - c t^2 / 2) on t >= 0: a Gaussian cut off on the slope, in the limit c -> 0 an exponential.

With z = s / sqrt(c) and Mills' ratio R(z) = (1 - Phi(z)) / phi(z), its integral is R(z) / sqrt(c), its mean
(1 / R(z) - z) / sqrt(c). The ratio is computed from the normal's tail below z = 3, and from Laplace's continued fraction
z + 1 / (z + 2 / (z + 3 / ...)) above, so that nothing cancels however steep the slope is.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import Array
from jax.scipy.special import log_ndtr

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
