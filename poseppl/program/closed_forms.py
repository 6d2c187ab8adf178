"""Closed forms that a distribution may have; an observation program that samples from it is then faster.

All are optional, and found by their methods' names: a distribution need not inherit anything. They say the same as the
distribution's `log_prob`, `loc` and `scale` do, in another way, and :func:`check_closed_forms` compares them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array


@runtime_checkable
class SummedDensity(Protocol):
    """A distribution that sums the log-density of its value itself: in one pass, without an array of the single terms."""

    def summed_log_prob(self, value: Array, mask: Array | None) -> Array:
        """Log-density of the entries of a value where a mask of its shape is true (None: of all), a scalar."""
        ...


@runtime_checkable
class WhitenedJacobian(Protocol):
    """A Gaussian distribution that knows the derivative of its location, divided by its standard deviation.

    Attributes:
        state: Its argument (n,), as it was given to the distribution: mostly the model's state.
        fixed: All else that its location is computed from. If this depends on the model's state, too, the closed form does not
            apply, and automatic differentiation is used.
    """

    state: Array

    @property
    def fixed(self) -> Any:
        """A tree of arrays."""
        ...

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """R^(-1/2) d location / d state (entries of the value, n); rows of entries where the mask is false are 0."""
        ...


@runtime_checkable
class CurvatureRows(Protocol):
    """A :class:`WhitenedJacobian` whose curvature is not Gauss-Newton's, such as one of robust residuals."""

    def curvature_rows(self, mask: Array | None) -> Array:
        """Rows (any number, n) whose squares add up to the curvature of -log p by the state, without masked entries."""
        ...


def check_closed_forms(
    distribution_of: Callable[[Array], dist.Distribution], state: Any, value: Any, *, tolerance: float = 1e-3
) -> None:
    """Compare a distribution's closed forms with its `log_prob` and with automatic differentiation.

    Args:
        distribution_of: The distribution as a function of its `state`.
        state: The point (n,) at which they are compared.
        value: A value of the distribution; every other entry is checked as masked.
        tolerance: Largest difference that is accepted, as a share of the largest entry.

    Raises:
        ValueError: The two differ, or the distribution knows neither.
    """
    state, distribution = jnp.asarray(state), distribution_of(jnp.asarray(state))
    sums, knows_jacobian = isinstance(distribution, SummedDensity), isinstance(distribution, WhitenedJacobian)
    if not (sums or knows_jacobian):
        raise ValueError(f"{type(distribution).__name__} has neither summed_log_prob nor whitened_jacobian")
    value = jnp.asarray(value)
    mask = jnp.arange(value.size).reshape(value.shape) % 2 == 0
    if sums:
        events = jnp.all(mask, axis=tuple(range(-distribution.event_dim, 0)))
        terms = distribution.log_prob(value)
        _same("summed_log_prob(value, None)", distribution.summed_log_prob(value, None), jnp.sum(terms), tolerance)
        expected = jnp.sum(jnp.where(events, terms, 0.0))
        _same("summed_log_prob(value, mask)", distribution.summed_log_prob(value, mask), expected, tolerance)
    if knows_jacobian:
        scale = jnp.broadcast_to(distribution.scale, distribution.shape())
        jacobian = jax.jacrev(lambda x: jnp.ravel(jnp.broadcast_to(distribution_of(x).loc, scale.shape) / scale))(state)
        _same("whitened_jacobian(None)", distribution.whitened_jacobian(None), jacobian, tolerance)
        expected = jnp.where(jnp.ravel(mask)[:, None], jacobian, 0.0)
        _same("whitened_jacobian(mask)", distribution.whitened_jacobian(mask), expected, tolerance)


def _same(what: str, found: Array, expected: Array, tolerance: float) -> None:
    if found.shape != expected.shape:
        raise ValueError(f"{what} has the shape {found.shape}. Expected {expected.shape}.")
    difference, size = float(jnp.max(jnp.abs(found - expected))), float(jnp.max(jnp.abs(expected)))
    if not difference <= tolerance * max(size, 1e-30):
        raise ValueError(f"{what} differs by {difference:.3g} from what log_prob, loc and scale say (largest entry {size:.3g})")
