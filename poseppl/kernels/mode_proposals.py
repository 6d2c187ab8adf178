r"""Starts of a search for other modes, given one: starts from a mode and its covariance.

Other modes lie along the valleys of the cost, the directions that are most uncertain, and farther out than the covariance
reaches. Covariance scaled sampling (Sminchisescu and Triggs 2001, section 4.2) keeps the k largest principal axes of the
covariance and stretches it by s, 8 to 14 in the paper:

    N(mu, s sum over j <= k of lambda_j v_j v_j^T),    or the points    mu +- sqrt(s lambda_j) v_j.

Its rivals inflate the dynamical noise Q, alike in all directions: N(mu, s Q), the search of CONDENSATION, and N(mu, S + s Q),
that of multiple hypothesis tracking (Cham and Rehg 1999, doi:10.1109/CVPR.1999.784636).

Principal axes depend on units, and a state has several: they are taken in `units`, one for each coordinate, such as the
standard deviations of a step of the transition.
"""

from __future__ import annotations

from typing import Literal, Protocol

import jax
import jax.numpy as jnp
from jax import Array

Pattern = Literal["regular", "random"]
_RINGS = (1.0, 0.5, 1.5, 0.25, 0.75, 1.25, 1.75)
"""Radii of a regular pattern, in the order in which its rings are filled; after the last they come again."""


class ModeProposal(Protocol):
    """A proposal of starts."""

    def __call__(self, rng_key: Array, mode: Array, covariance: Array) -> Array:
        """Starts (n, d) from a mode (d,) and its covariance (d, d)."""


def principal_axes(covariance: Array, units: Array, number: int) -> Array:
    """The k largest principal axes (k, d), each as long as its standard deviation, of a covariance (d, d) in units (d,)."""
    values, vectors = jnp.linalg.eigh(covariance / units[:, None] / units)
    longest = jnp.sqrt(jnp.maximum(values[::-1][:number], 0.0))
    axes: Array = longest[:, None] * vectors[:, ::-1][:, :number].T * units
    return axes


def covariance_scaled(
    num_starts: int, units: Array, *, num_directions: int = 6, stretch: float = 10.0, pattern: Pattern = "regular"
) -> ModeProposal:
    """Sample along the most uncertain directions.

    Args:
        num_starts: n. A regular pattern fills its outer ring first, 2 k starts, then rings of other radii.
        units: Units of the coordinates (d,).
        num_directions: k, at most d are used.
        stretch: s, the factor of the covariance.
        pattern: "regular", points on the axes alone, or "random".
    """

    def propose(rng_key: Array, mode: Array, covariance: Array) -> Array:
        number = min(num_directions, mode.shape[0])
        axes = jnp.sqrt(jnp.asarray(stretch, mode.dtype)) * principal_axes(covariance, units, number)
        if pattern == "random":
            return mode + jax.random.normal(rng_key, (num_starts, number), mode.dtype) @ axes
        index = jnp.arange(num_starts)
        radius = jnp.asarray(_RINGS, mode.dtype)[index // (2 * number) % len(_RINGS)]
        return mode + ((-1) ** index * radius)[:, None] * axes[index // 2 % number]

    return propose


def dynamic_noise(num_starts: int, noise: Array, *, stretch: float = 1.0, spread: bool = False) -> ModeProposal:
    """Sample by inflated dynamical noise.

    Args:
        num_starts: n.
        noise: Q (d, d).
        stretch: s, the factor of Q.
        spread: Whether the mode's own covariance is added, as in multiple hypothesis tracking.
    """

    def propose(rng_key: Array, mode: Array, covariance: Array) -> Array:
        whole = stretch * noise + (covariance if spread else 0.0)
        unit = jnp.sqrt(jnp.diagonal(whole))
        lower = jnp.linalg.cholesky(whole / unit[:, None] / unit)
        starts: Array = mode + unit * (jax.random.normal(rng_key, (num_starts, mode.shape[0]), mode.dtype) @ lower.T)
        return starts

    return propose
