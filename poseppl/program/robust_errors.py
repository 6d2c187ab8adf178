r"""Robust errors: a Gaussian bent so that outliers count little (Sminchisescu and Triggs 2001, section 3.1).

For a residual vector r (n,) with weight matrix W, the inverse of the Gaussian's covariance,

    p(r) \propto exp(-rho(s) / 2),    s = r^T W r,    rho(0) = 0,    rho'(0) = 1,
    Lorentzian   rho(s) = nu log(1 + s / nu),
    Leclerc      rho(s) = nu (1 - exp(-s / nu)),

nu being the strength: errors of more than sqrt(nu) standard deviations count as outliers. The vector is the event of the
Gaussian: `dist.Normal(points, 3.0).to_event(1)` has image points as vectors, without `to_event` every entry is one by itself.

If the residual is a function of a state with derivative J, the gradient of -log p by the state is rho' J^T W r. Its curvature,
without the derivative of J (section 4.1), is

    J^T (rho' W + 2 rho'' (W r) (W r)^T) J,

which has rho' + 2 rho'' s along the residual: negative beyond some error, and 0 is taken there instead, as in
:mod:`poseppl.program.moments`.

>>> import jax.numpy as jnp
>>> import numpyro.distributions as dist
>>> errors = Lorentzian(dist.Normal(jnp.zeros((17, 2)), 3.0).to_event(1), 4.0)
>>> errors.batch_shape, errors.event_shape
((17,), (2,))
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array
from jax.scipy.linalg import solve_triangular
from jax.scipy.special import gammaln
from numpyro.distributions import constraints

from poseppl.checks import RangeError

_TERMS = 256
"""Gaussians that Leclerc's peak is a sum of: enough for strengths up to 300."""


class RobustError(dist.Distribution):  # type: ignore[misc]
    """A robust function of the squared error of a Gaussian.

    Args:
        gaussian: Location and scale of the errors: a Normal, also one of `to_event(1)`, or a MultivariateNormal. One that knows
            the derivative of its location (:class:`~poseppl.program.closed_forms.WhitenedJacobian`) is asked for it.
        strength: nu, positive.

    Attributes:
        gaussian: Without the wrapper of `to_event`.
    """

    pytree_data_fields: tuple[str, ...] = ("gaussian", "strength")
    reparametrized_params = ["gaussian", "strength"]

    def __init__(self, gaussian: dist.Distribution, strength: Any, *, validate_args: bool | None = None) -> None:
        batch_shape, event_shape = gaussian.batch_shape, gaussian.event_shape
        if isinstance(gaussian, dist.Independent) and len(event_shape) == 1:
            gaussian = gaussian.base_dist
        if not isinstance(gaussian, dist.Normal | dist.MultivariateNormal):
            kind = type(gaussian).__name__
            raise ValueError(f"gaussian is a {kind}. Expected a Normal, with or without to_event(1), or a MultivariateNormal.")
        self.gaussian, self.strength = gaussian, strength
        if not isinstance(strength, jax.core.Tracer) and np.any(np.asarray(strength) <= self.least_strength(event_shape)):
            expected = f"more than {self.least_strength(event_shape)}, or the density has no integral"
            raise RangeError("strength", strength, expected)
        super().__init__(batch_shape, event_shape, validate_args=validate_args)

    @staticmethod
    def least_strength(event_shape: tuple[int, ...]) -> float:
        """The number that a strength has to exceed."""
        return 0.0

    @property
    def support(self) -> Any:
        """All vectors."""
        return constraints.independent(constraints.real, self.event_dim)

    @property
    def size(self) -> int:
        """Length n of a residual vector."""
        return math.prod(self.event_shape)

    @abstractmethod
    def potential(self, squared: Array) -> Array:
        """The potential rho of squared errors."""

    @abstractmethod
    def derivatives(self, squared: Array) -> tuple[Array, Array]:
        """First and second derivative of rho by the squared error."""

    @abstractmethod
    def log_constant(self) -> Array:
        """Logarithm of the integral of exp(-rho / 2) over residuals of unit weight."""

    def whitened_residual(self, value: Array) -> Array:
        """W^(1/2) r of each vector: batch shape and event shape, (1,) where an entry is a vector by itself."""
        residual = value - self.gaussian.loc
        if isinstance(self.gaussian, dist.Normal):
            white = residual / self.gaussian.scale
        else:
            lower = jnp.broadcast_to(self.gaussian.scale_tril, (*residual.shape, residual.shape[-1]))
            white = solve_triangular(lower, residual[..., None], lower=True)[..., 0]
        vectors: Array = white if self.event_dim else white[..., None]
        return vectors

    def log_volume(self) -> Array:
        """Logarithm of the determinant of W^(-1/2)."""
        if isinstance(self.gaussian, dist.MultivariateNormal):
            return jnp.sum(jnp.log(jnp.diagonal(self.gaussian.scale_tril, axis1=-2, axis2=-1)), -1)
        scale = jnp.broadcast_to(self.gaussian.scale, (*self.batch_shape, *self.event_shape))
        return jnp.sum(jnp.log(scale), -1) if self.event_dim else jnp.log(scale)

    def log_prob(self, value: Array) -> Array:
        """Log-density of vectors (batch shape)."""
        squared = jnp.sum(self.whitened_residual(value) ** 2, -1)
        density: Array = -0.5 * self.potential(squared) - self.log_constant() - self.log_volume()
        return density

    def _place(self, white: Array) -> Any:
        """Values from residuals of unit weight (..., batch shape, n)."""
        if isinstance(self.gaussian, dist.MultivariateNormal):
            return self.gaussian.loc + jnp.einsum("...ij,...j->...i", self.gaussian.scale_tril, white)
        return self.gaussian.loc + self.gaussian.scale * (white if self.event_dim else white[..., 0])


class Lorentzian(RobustError):
    r"""Errors of potential nu log(1 + s / nu): Student's t, in other words.

    Its density is (1 + s / nu)^(-nu / 2) times a constant, that of a (multivariate) Student's t of nu - n degrees of freedom
    and scale matrix nu / (nu - n) W^-1: so nu has to exceed n, the length of a vector.

    Args:
        gaussian: Location and scale of the errors.
        strength: nu.
    """

    @staticmethod
    def least_strength(event_shape: tuple[int, ...]) -> float:
        """The length of a vector."""
        return float(math.prod(event_shape))

    def potential(self, squared: Array) -> Array:
        """The potential rho of squared errors."""
        potential: Array = self.strength * jnp.log1p(squared / self.strength)
        return potential

    def derivatives(self, squared: Array) -> tuple[Array, Array]:
        """First and second derivative of rho by the squared error."""
        first = 1.0 / (1.0 + squared / self.strength)
        return first, -(first**2) / self.strength

    def log_constant(self) -> Array:
        """Logarithm of the integral of exp(-rho / 2) over residuals of unit weight."""
        half = 0.5 * jnp.asarray(self.strength, jnp.result_type(float))
        return 0.5 * self.size * jnp.log(2 * jnp.pi * half) + gammaln(half - 0.5 * self.size) - gammaln(half)

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw values (sample shape, batch shape, event shape)."""
        key_normal, key_scale = jax.random.split(key)
        shape = (*sample_shape, *self.batch_shape)
        normal = jax.random.normal(key_normal, (*shape, self.size))
        # s / nu is a ratio of two chi-squares, that below of nu - n degrees of freedom
        chi_squared = 2.0 * jax.random.gamma(key_scale, 0.5 * (jnp.asarray(self.strength) - self.size), shape)
        draws: Array = self._place(normal * jnp.sqrt(jnp.asarray(self.strength) / chi_squared)[..., None])
        return draws

    @property
    def mean(self) -> Array:
        """The location, where there is a mean; else NaN."""
        freedom = self._per_entry(jnp.asarray(self.strength) - self.size)
        return jnp.where(freedom > 1, self.gaussian.mean, jnp.nan)

    @property
    def variance(self) -> Array:
        """Variance of each entry, infinite below 2 degrees of freedom."""
        freedom = self._per_entry(jnp.asarray(self.strength) - self.size)
        ratio = self._per_entry(jnp.asarray(self.strength)) / jnp.where(freedom > 2, freedom - 2, 1.0)
        return jnp.where(freedom > 2, ratio * self.gaussian.variance, jnp.inf)

    def _per_entry(self, strength: Array) -> Array:
        return jnp.broadcast_to(strength, self.batch_shape)[..., None] if self.event_dim else strength


class Leclerc(RobustError):
    r"""Errors of potential nu (1 - exp(-s / nu)): beyond some standard deviations an outlier counts no more at all.

    The density tends to exp(-nu / 2) and has no integral over all of space. With a `window`, the volume in which data can lie
    (of an image its area, in units of the data), it is normalised over that: outliers are uniform in it, and the peak, which is
    a sum of Gaussians,

        exp(-rho / 2) - exp(-nu / 2) = exp(-nu / 2) sum over k >= 1 of (nu / 2)^k / k! exp(-k s / nu),

    is taken to lie inside. Without one it is an unnormalised factor: posterior and modes are what they are, but evidence means
    nothing, the scale cannot be learned from it, and predictive checks refuse it.

    Args:
        gaussian: Location and scale of the errors.
        strength: nu, up to 300.
        window: Volume of the data's space; None for an unnormalised factor.
    """

    pytree_data_fields = ("gaussian", "strength", "window")

    def __init__(
        self, gaussian: dist.Distribution, strength: Any, window: Any = None, *, validate_args: bool | None = None
    ) -> None:
        self.window = window
        super().__init__(gaussian, strength, validate_args=validate_args)

    is_predictive = False
    """Draws are of the peak alone: a window's volume does not determine its position."""

    def potential(self, squared: Array) -> Array:
        """The potential rho of squared errors."""
        potential: Array = -self.strength * jnp.expm1(-squared / self.strength)
        return potential

    def derivatives(self, squared: Array) -> tuple[Array, Array]:
        """First and second derivative of rho by the squared error."""
        first = jnp.exp(-squared / self.strength)
        return first, -first / self.strength

    def log_constant(self) -> Array:
        """Logarithm of the integral of exp(-rho / 2) over the window of residuals of unit weight; 0 without a window."""
        if self.window is None:
            return -self.log_volume()
        outliers = jnp.log(jnp.asarray(self.window)) - self.log_volume()
        return jnp.logaddexp(jax.nn.logsumexp(self._log_masses(), -1), outliers) - 0.5 * jnp.asarray(self.strength)

    def _log_masses(self) -> Array:
        """Log-masses (..., terms) of the Gaussians in the peak, exp(-nu / 2) left out."""
        strength = jnp.asarray(self.strength, jnp.result_type(float))[..., None]
        terms = jnp.arange(1.0, _TERMS + 1.0)
        volume = 0.5 * self.size * jnp.log(jnp.pi * strength / terms)
        return terms * jnp.log(0.5 * strength) - gammaln(terms + 1.0) + volume

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw values (sample shape, batch shape, event shape) from the peak alone."""
        key_normal, key_term = jax.random.split(key)
        shape = (*sample_shape, *self.batch_shape)
        term = 1 + jax.random.categorical(key_term, jnp.broadcast_to(self._log_masses(), (*shape, _TERMS)))
        normal = jax.random.normal(key_normal, (*shape, self.size))
        draws: Array = self._place(normal * jnp.sqrt(0.5 * jnp.asarray(self.strength) / term)[..., None])
        return draws
