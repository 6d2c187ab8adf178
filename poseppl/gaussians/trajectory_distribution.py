"""The Gaussian of a trajectory with a block-tridiagonal precision, as a NumPyro distribution."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array

from poseppl.gaussians.block_tridiagonal import BlockCholesky, solve_upper


class TrajectoryNormal(dist.Distribution):  # type: ignore[misc]
    """A Gaussian of trajectories (T, d); O(T d^2) to draw.

    The density's derivative is by the trajectory alone and not by the parameters: as the guide of a variational fit it sticks
    the landing.

    Args:
        loc: The mean (T, d).
        factor: Cholesky factor of the precision.
    """

    support = dist.constraints.independent(dist.constraints.real, 2)
    reparametrized_params = ["loc"]

    def __init__(self, loc: Array, factor: BlockCholesky) -> None:
        self.loc, self.factor = loc, factor
        super().__init__(event_shape=loc.shape)

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Trajectories (*sample_shape, T, d)."""
        noise = jax.random.normal(key, (*sample_shape, *self.event_shape), self.loc.dtype)
        solve = jnp.vectorize(lambda z: solve_upper(self.factor, z), signature="(t,d)->(t,d)")
        drawn: Array = self.loc + solve(noise)
        return drawn

    def log_prob(self, value: Array, intermediates: Any = None) -> Array:
        """Log-density of trajectories (..., T, d)."""
        loc, (inverses, gains) = jax.lax.stop_gradient((self.loc, self.factor))
        off = value - loc
        joined = off.at[..., :-1, :].add(jnp.einsum("tij,...ti->...tj", gains, off[..., 1:, :]))
        white = jnp.vectorize(
            lambda w, y: jax.scipy.linalg.solve_triangular(w, y, trans=1, lower=True), signature="(d,d),(d)->(d)"
        )(inverses, joined)
        half_log_det = -jnp.sum(jnp.log(jnp.diagonal(inverses, axis1=1, axis2=2)))
        density: Array = half_log_det - 0.5 * jnp.sum(white**2, (-2, -1)) - 0.5 * loc.size * jnp.log(2 * jnp.pi)
        return density
