"""Adaptive resampling: ancestors are drawn by weight at the frames where ESS <= threshold * N, and elsewhere kept."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from poseppl.checks import check_at_least, check_fraction
from poseppl.particles.resampling import Resampling, Scheme, resampling_scheme
from poseppl.particles.weights import effective_sample_size


class Ancestry(NamedTuple):
    """Ancestors (N,) and the log-weights (N,) that their children start with, which sum to one in expectation."""

    ancestors: jax.Array
    log_weights: jax.Array


class AdaptiveResampling(NamedTuple):
    """When and how N particles are resampled.

    Attributes:
        num_particles: N.
        scheme: How ancestors are drawn.
        ess_threshold: Resample when ESS <= threshold * N: 1 at every frame, 0 never.
    """

    num_particles: int
    scheme: Resampling
    ess_threshold: float

    def everyone(self) -> jax.Array:
        """The ancestors (N,) int32 when each particle is its own."""
        return jnp.arange(self.num_particles, dtype=jnp.int32)

    def choose(self, rng_key: jax.Array, log_weights: jax.Array, log_start: jax.Array, log_kept: jax.Array) -> Ancestry:
        """Draw ancestors, or keep every particle.

        Args:
            rng_key: PRNG key.
            log_weights: Normalised log-weights (N,) to draw by, and to take the ESS of.
            log_start: Log-weight (N,) that the children of each particle start with.
            log_kept: The same where particles are kept.
        """

        def resampled() -> Ancestry:
            ancestors = self.scheme(rng_key, log_weights, self.num_particles)
            return Ancestry(ancestors, log_start[ancestors])

        def kept() -> Ancestry:
            return Ancestry(self.everyone(), log_kept)

        if self.ess_threshold == 0:
            return kept()
        if self.ess_threshold == 1:
            return resampled()
        needed = effective_sample_size(log_weights) <= self.ess_threshold * self.num_particles
        chosen: Ancestry = jax.lax.cond(needed, resampled, kept)
        return chosen


def adaptive_resampling(num_particles: int, resampling: Scheme, ess_threshold: float) -> AdaptiveResampling:
    """Check a particle filter's settings and gather them.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
    """
    check_at_least(1, num_particles=num_particles)
    check_fraction("[0, 1]", ess_threshold=ess_threshold)
    return AdaptiveResampling(num_particles, resampling_scheme(resampling), ess_threshold)
