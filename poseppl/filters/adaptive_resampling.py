r"""Adaptive resampling: ancestors are drawn by weight at the frames where ESS <= threshold * N, and elsewhere kept.

Derivatives are those of Scibior and Wood 2021 (arXiv:2106.10314): ancestors are drawn unchanged, and a child starts with the
weight of value 1 and derivative d log w of its ancestor, w / stopped(w). So the evidence's estimate, which is linear in the
weights, has a derivative whose mean is the derivative of the evidence; without it the derivative would leave out that other
parameters choose other ancestors. That of the estimate's logarithm is biased as the logarithm is, by O(1 / N).
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from poseppl.checks import check_at_least, check_fraction
from poseppl.particles.resampling import Resampling, Scheme, resampling_scheme
from poseppl.particles.weights import effective_sample_size, normalise


class Ancestry(NamedTuple):
    """The ancestors of the particles of a frame.

    Attributes:
        ancestors: Shape (N,), int32.
        log_weights: Log-weights (N,) that their children start with, which sum to one in expectation.
        ess: That of the weights that they were drawn by, where these looked ahead; else N.
    """

    ancestors: Array
    log_weights: Array
    ess: Array


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

    def keep(self, log_weights: Array) -> Ancestry:
        """Each particle its own ancestor, with its own weight."""
        count = self.num_particles
        return Ancestry(jnp.arange(count, dtype=jnp.int32), log_weights, jnp.asarray(count, log_weights.dtype))

    def choose(self, rng_key: Array, log_weights: Array, lookahead: Array | None = None) -> Ancestry:
        """Draw ancestors, or keep every particle.

        Args:
            rng_key: PRNG key.
            log_weights: Normalised log-weights (N,).
            lookahead: Log lambda (N,), what the data say of each particle as an ancestor: drawn by w lambda, a child starts
                with the mean of w lambda over its ancestor's lambda. None draws by w alone.
        """
        log_drawn, log_start = log_weights, jnp.full_like(log_weights, -jnp.log(self.num_particles))
        ess = jnp.asarray(self.num_particles, log_weights.dtype)
        if lookahead is not None:
            staged = normalise(log_weights + lookahead)
            log_drawn, log_start, ess = staged.log_weights, staged.log_mean - lookahead, staged.ess

        def resampled() -> Ancestry:
            ancestors = self.scheme(rng_key, jax.lax.stop_gradient(log_drawn), self.num_particles)
            return Ancestry(ancestors, _children(log_start, log_drawn, ancestors), ess)

        if self.ess_threshold == 0:
            return self.keep(log_weights)
        if self.ess_threshold == 1:
            return resampled()
        needed = effective_sample_size(log_drawn) <= self.ess_threshold * self.num_particles
        chosen: Ancestry = jax.lax.cond(needed, resampled, lambda: self.keep(log_weights))
        return chosen


@jax.custom_jvp
def _children(log_start: Array, log_drawn: Array, ancestors: Array) -> Array:
    """Log-weights (N,) of children; their derivatives know the weights that their ancestors were drawn by."""
    return log_start[ancestors]


@_children.defjvp
def _children_jvp(primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]) -> tuple[Array, Array]:
    (log_start, log_drawn, ancestors), (start, drawn, _) = primals, tangents
    known = jnp.isfinite(log_drawn[ancestors])
    return log_start[ancestors], start[ancestors] + jnp.where(known, drawn[ancestors], 0.0)


def adaptive_resampling(num_particles: int, resampling: Scheme, ess_threshold: float) -> AdaptiveResampling:
    """Check a particle filter's settings and gather them.

    Raises:
        ValueError: A number below 1, a threshold outside [0, 1] or an unknown scheme.
    """
    check_at_least(1, num_particles=num_particles)
    check_fraction("[0, 1]", ess_threshold=ess_threshold)
    return AdaptiveResampling(num_particles, resampling_scheme(resampling), ess_threshold)
