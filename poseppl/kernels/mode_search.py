"""Mode search under constraints: climb from many starts, merge the climbs that came to one mode, and starts from a mode.

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

from typing import Literal, NamedTuple, Protocol

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.compilation import with_full_precision
from poseppl.kernels.constraints import Constraints
from poseppl.kernels.face_laplace import FaceModes, face_modes
from poseppl.kernels.laplace import group_modes
from poseppl.kernels.trust_region import Curvature, LogDensity, climb_modes

_COINCIDE = 1.0
"""Standard deviations of both Laplace approximations within which two climbs came to the same mode."""


class ModeSearchResult(NamedTuple):
    """Distinct modes, the heaviest first.

    Attributes:
        modes: With a leading axis of K; those beyond the number found are copies of the heaviest, of log-mass -inf.
        log_mass: Logarithm of the sum of all distinct modes' masses, those included that were not kept, a scalar.
        number: How many distinct modes there are, int32.
        labels: For each start the index of the start that stands for its mode (S,); its own where its climb has no mass.
        evaluations: Evaluations of density, gradient and curvature, all climbs together, int32.
    """

    modes: FaceModes
    log_mass: Array
    number: Array
    labels: Array
    evaluations: Array


@with_full_precision
def search_modes(
    starts: Array,
    log_density: LogDensity,
    curvature: Curvature,
    constraints: Constraints,
    num_modes: int,
    *,
    units: Array | None = None,
    num_steps: int = 40,
) -> ModeSearchResult:
    """Find the heaviest modes of a density under constraints.

    Args:
        starts: Shape (S, d).
        log_density: Unnormalised log-density of one state, a scalar.
        curvature: Curvature (d, d) of its negative at one state.
        constraints: Constraints of the states.
        num_modes: K, how many are kept, at most S.
        units: Units of the coordinates (d,), see :func:`~poseppl.kernels.trust_region.climb_modes`.
        num_steps: Steps of each climb at most.
    """
    climbs = climb_modes(starts, log_density, curvature, constraints, units=units, num_steps=num_steps)
    modes = face_modes(climbs, constraints)
    labels = representatives(modes)
    distinct = (labels == jnp.arange(len(starts))) & jnp.isfinite(modes.log_masses)
    masses = jnp.where(distinct, modes.log_masses, -jnp.inf)
    values, order = jax.lax.top_k(masses, min(num_modes, len(starts)))
    order = jnp.where(jnp.isfinite(values), order, order[0])
    kept: FaceModes = jax.tree.map(lambda leaf: leaf[order], modes)
    return ModeSearchResult(
        kept._replace(log_masses=values),
        jax.nn.logsumexp(masses),
        jnp.sum(distinct, dtype=jnp.int32),
        labels,
        jnp.sum(climbs.evaluations),
    )


def representatives(modes: FaceModes) -> Array:
    """For each of S climbs the index (S,) of the one that stands for its mode: the heaviest of those that coincide."""
    labels = group_modes(modes, _COINCIDE, mutual=True)
    together = labels[:, None] == labels
    heaviest = jnp.argmax(jnp.where(together, modes.log_masses, -jnp.inf), 1)
    return jnp.where(jnp.isfinite(modes.log_masses), heaviest, jnp.arange(len(labels)))


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
