"""Mode search under constraints: climb from many starts, merge the climbs that came to one mode, keep the best."""

from __future__ import annotations

from typing import NamedTuple

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
