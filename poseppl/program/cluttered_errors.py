r"""Errors of a detector that is sometimes altogether wrong: Student's t, mixed with points anywhere in the picture.

For an error vector r (n,) with weights W, the inverse of the squared scale, a window of volume V, and log-odds c of clutter,

    p(r) = (1 - pi) t_nu(r; W^-1) + pi / V,    pi = 1 / (1 + exp(-c)).

It is a robust error (:mod:`poseppl.program.robust_errors`) of the potential

    rho(s) = -2 log(exp(-rho_t(s) / 2) + exp(o)),    rho_t(s) = (nu + n) log(1 + s / nu),
    o = c - log V - log t_nu(0; W^-1),

o being the log-ratio of the two densities in the middle. Its derivative is rho_t' times the probability that the point is not
clutter. A point far away has no influence at all; under Student's t alone it has a little.

>>> import jax.numpy as jnp
>>> import numpyro.distributions as dist
>>> errors = Cluttered(dist.Normal(jnp.zeros((12, 2)), 2.0).to_event(1), 5.0, -4.0, jnp.array([640.0, 480.0]))
>>> near, far = jnp.zeros((12, 2)), jnp.full((12, 2), 200.0)
>>> bool(errors.clutter_probability(near)[0] < 1e-4), bool(errors.clutter_probability(far)[0] > 0.9)
(True, True)
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from jax.scipy.special import gammaln

from poseppl.program.robust_errors import RobustError


class Cluttered(RobustError):
    """Student's t errors mixed with clutter that is uniform in a window.

    Args:
        gaussian: Location and scale of the t, a Normal.
        freedom: nu, its degrees of freedom.
        log_odds: c, of clutter.
        window: Sides (n,) of the box from the origin in which clutter lies, or anything that broadcasts to events.
    """

    pytree_data_fields = ("gaussian", "strength", "log_odds", "window")

    def __init__(
        self, gaussian: dist.Distribution, freedom: Any, log_odds: Any, window: Any, *, validate_args: bool | None = None
    ) -> None:
        self.log_odds, self.window = log_odds, window
        super().__init__(gaussian, freedom, validate_args=validate_args)

    def _log_window(self) -> Array:
        sides: Array = jnp.log(jnp.asarray(self.window))
        return jnp.sum(jnp.broadcast_to(sides, (*self.batch_shape, *self.event_shape)), -1) if self.event_dim else sides

    def _log_constant_t(self) -> Array:
        """Logarithm of the integral of exp(-rho_t / 2) over residuals of unit weight."""
        nu = jnp.asarray(self.strength, jnp.result_type(float))
        return 0.5 * self.size * jnp.log(jnp.pi * nu) + gammaln(0.5 * nu) - gammaln(0.5 * (nu + self.size))

    def _log_offset(self) -> Array:
        """O."""
        return jnp.asarray(self.log_odds) - self._log_window() + self._log_constant_t() + self.log_volume()

    def _log_peak(self, squared: Array) -> Array:
        """-rho_t / 2."""
        nu = self.strength
        peak: Array = -0.5 * (nu + self.size) * jnp.log1p(squared / nu)
        return peak

    def potential(self, squared: Array) -> Array:
        """The potential rho of squared errors, whose value at 0 is not 0 where there is clutter."""
        return -2.0 * jnp.logaddexp(self._log_peak(squared), self._log_offset())

    def derivatives(self, squared: Array) -> tuple[Array, Array]:
        """First and second derivative of rho by the squared error."""
        nu, size = self.strength, self.size
        mine = jax.nn.sigmoid(self._log_peak(squared) - self._log_offset())
        first = (nu + size) / (nu + squared)
        second = -first / (nu + squared)
        return mine * first, mine * second - 0.5 * mine * (1 - mine) * first**2

    def log_constant(self) -> Array:
        """Logarithm of the integral of exp(-rho / 2) over residuals of unit weight in the window."""
        return self._log_constant_t() + jax.nn.softplus(jnp.asarray(self.log_odds))

    def clutter_probability(self, value: Array) -> Array:
        """Probability (batch shape) that values are clutter."""
        squared = jnp.sum(self.whitened_residual(value) ** 2, -1)
        return jax.nn.sigmoid(self._log_offset() - self._log_peak(squared))

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw values (sample shape, batch shape, event shape)."""
        normal_key, scale_key, which_key, place_key = jax.random.split(key, 4)
        shape = (*sample_shape, *self.batch_shape)
        normal = jax.random.normal(normal_key, (*shape, self.size))
        half = 0.5 * jnp.asarray(self.strength, normal.dtype)
        precision = jax.random.gamma(scale_key, half, shape) / half
        draws = self._place(normal / jnp.sqrt(precision)[..., None])
        anywhere = jax.random.uniform(place_key, draws.shape) * jnp.asarray(self.window)
        wrong = jax.random.bernoulli(which_key, jax.nn.sigmoid(jnp.asarray(self.log_odds)), shape)
        return jnp.where(wrong[..., None] if self.event_dim else wrong, anywhere, draws)
