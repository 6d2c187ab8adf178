"""The distribution of a datum that a later frame reads: its value where it was seen, its own law where it was not.

    y ~ delta(y - datum)    if it was seen,        y ~ p(y | x)    if it is missing.

A `MultivariateNormal` that was seen in part has the law of its missing entries given those that were seen.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from numpyro.distributions import constraints

from poseppl.program.execution import base_support, event_mask, unwrap
from poseppl.program.partly_seen import entry_log_densities, seen_factor


class Returned(dist.Delta):  # type: ignore[misc]
    """A datum as a site of the state.

    Args:
        value: The datum, of the site's shape; not read where it was not seen.
        seen: Which entries were seen, of the same shape.
        law: Its distribution given its own frame's state; None if all of it was seen.
        event_dim: Event dimensions, where there is no law.
    """

    pytree_data_fields = ("seen", "law")

    def __init__(self, value: Any, seen: Any, law: dist.Distribution | None = None, event_dim: int = 0) -> None:
        self.seen, self.law = jnp.asarray(seen), law
        super().__init__(value, event_dim=event_dim if law is None else law.event_dim, validate_args=False)

    @constraints.dependent_property  # type: ignore[untyped-decorator]
    def support(self) -> constraints.Constraint:
        """All reals, or integers: bounds of the law do not bind a datum."""
        if jnp.issubdtype(jnp.result_type(self.v), jnp.floating):
            return constraints.independent(constraints.real, self.event_dim)
        return self.law.support if self.law is not None else constraints.independent(_INTEGERS, self.event_dim)

    @property
    def has_rsample(self) -> bool:
        """Whether a draw has a derivative: that of the law."""
        return self.law is None or bool(self.law.has_rsample)

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """The datum where it was seen, else a draw."""
        value = jnp.broadcast_to(self.v, (*sample_shape, *self.shape()))
        if self.law is None:
            return value
        if not self._divisible:
            return jnp.where(self.seen, value, self.law.sample(key, sample_shape).astype(value.dtype))
        mean, covariance = self._given_seen()
        noise = jax.random.normal(key, value.shape, value.dtype)
        drawn = mean + jnp.einsum("...ij,...j->...i", seen_factor(covariance, ~self.seen), jnp.where(self.seen, 0.0, noise))
        return jnp.where(self.seen, value, drawn)

    def log_prob(self, value: Any) -> Array:
        """Log-density of the missing part, given the part that was seen, which adds 0."""
        if self.law is None:
            return jnp.zeros(self.batch_shape)
        if self._divisible:
            mean, covariance = self._given_seen()
            return jnp.sum(entry_log_densities(value - mean, covariance, ~self.seen), -1)
        safe = jnp.where(self.seen, self.v, value)  # a datum within the support, whose density is finite
        return jnp.where(event_mask(self.seen, self.event_dim), 0.0, self.law.log_prob(safe))

    @property
    def mean(self) -> Array:
        """The datum where it was seen, else the law's mean."""
        if self.law is None:
            return jnp.asarray(self.v)
        return self._given_seen()[0] if self._divisible else jnp.where(self.seen, self.v, self._of_real("mean"))

    @property
    def variance(self) -> Array:
        """0 where it was seen, else the law's variance."""
        if self.law is None:
            return jnp.zeros(self.shape())
        if self._divisible:
            variance: Array = jnp.diagonal(self.covariance_matrix, axis1=-2, axis2=-1)
            return variance
        return jnp.where(self.seen, 0.0, self._of_real("variance"))

    @property
    def covariance_matrix(self) -> Array:
        """Covariance of each event (..., n, n)."""
        if self.law is not None and self._divisible:
            return self._given_seen()[1]
        return self.variance[..., None] * jnp.eye(self.shape()[-1])

    def _of_real(self, which: str) -> Array:
        """A moment of the law.

        Raises:
            NotImplementedError: It has bounds, and is no Gaussian over the real line.
        """
        assert self.law is not None
        if base_support(self.law.support) is not constraints.real:
            raise NotImplementedError
        return jnp.asarray(getattr(self.law, which))

    @property
    def _divisible(self) -> bool:
        return type(unwrap(self.law)) is dist.MultivariateNormal

    def _given_seen(self) -> tuple[Array, Array]:
        """Mean (..., n) and covariance (..., n, n) of a Gaussian given the entries that were seen."""
        base = unwrap(self.law)
        size = self.shape()[-1]
        loc = jnp.broadcast_to(base.loc, self.shape())
        whole = jnp.broadcast_to(base.covariance_matrix, (*self.shape(), size))
        crossed = jnp.where(self.seen[..., None, :] & ~self.seen[..., :, None], whole, 0.0)
        gain = jax.scipy.linalg.cho_solve((seen_factor(whole, self.seen), True), jnp.swapaxes(crossed, -1, -2))
        residual = jnp.where(self.seen, self.v - loc, 0.0)
        mean = jnp.where(self.seen, self.v, loc + jnp.einsum("...ji,...j->...i", gain, residual))
        missing = ~self.seen[..., None, :] & ~self.seen[..., :, None]
        return mean, jnp.where(missing, whole - crossed @ gain, 0.0)


_INTEGERS = constraints.integer_greater_than(-jnp.inf)
"""The support of a datum that is an integer, before its law is known."""
