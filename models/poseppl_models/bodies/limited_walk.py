"""A body's random walk within joint limits and about an equilibrium, and normal distributions within limits.

Joint limits are the supports of the sites, a normal step being cut off at them. Gaussian stabilisers N(mu, S^2) (Sminchisescu
and Triggs 2001, section 3.2) are the walk's stationary distribution: with a step of standard deviation s to this frame,

    x_t ~ N(mu + a (x_(t-1) - mu), S^2 (1 - a^2)),   a^2 = max(0, 1 - s^2 / S^2),

a walk of step s while S is large, and N(mu, S^2) itself where a step is as large as S. As a factor of every frame a stabiliser
would be the stronger the more frames a second has. The first state has the product of its own Gaussian and the stabiliser.

NumPyro maps an interval to the real line by a logistic function, which moves a limit to infinity: a straight knee, 5 degrees
from its limit, would lie in the tail. Here an angle within its limits stays an angle, as a circular one does. So the flat state
of a body is its pose, and its density is 0 (its logarithm -inf) beyond a limit. Searches for modes under bounds find these in
the site's support.

>>> import jax.numpy as jnp
>>> knee = LimitedNormal(jnp.array([-0.1]), 0.2, jnp.array([-2.36]), jnp.array([0.09]))
>>> knee.log_prob(jnp.array([0.2])).tolist()
[-inf]
>>> biject_to(knee.support).inv(jnp.array([0.0625])).tolist()
[0.0625]
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax import Array
from jax.scipy.special import erf
from numpyro.distributions import biject_to, constraints
from numpyro.distributions.transforms import IdentityTransform

from poseppl_models.bodies.random_walk import Programs


def limited_walk(spans: Mapping[str, slice], limits: Any, stabilisers: Any, equilibrium: Any = 0.0) -> Programs:
    """Write the initial and the transition program of the sites.

    Args:
        spans: The sites and their coordinates. Inputs have ``start``, ``start_scale`` and ``step_scale``, each (d,), as in
            :func:`poseppl_models.bodies.random_walk.random_walk`.
        limits: Least and largest value of each coordinate (d, 2), infinite where nothing limits it; a site without a limit is a
            plain Normal.
        stabilisers: S (d,), infinite where a coordinate has no stabiliser.
        equilibrium: mu, a number or (d,).
    """
    low, high = np.asarray(limits, float).T
    spread = np.asarray(stabilisers, float)
    rest = np.broadcast_to(np.asarray(equilibrium, float), spread.shape)

    def sample(name: str, loc: Any, scale: Any) -> None:
        span = spans[name]
        free = np.isinf(low[span]).all() and np.isinf(high[span]).all()
        limited = LimitedNormal(loc, scale, low[span], high[span], validate_args=False)
        numpyro.sample(name, dist.Normal(loc, scale, validate_args=False) if free else limited)

    def initial(params: Any, inputs: Any) -> None:
        for name, span in spans.items():
            start, scale = inputs.start[span], inputs.start_scale[span]
            ratio = (scale / spread[span]) ** 2
            sample(name, start + ratio / (1 + ratio) * (rest[span] - start), scale / jnp.sqrt(1 + ratio))

    def transition(params: Any, state: Mapping[str, Any], inputs: Any) -> None:
        for name, span in spans.items():
            step = inputs.step_scale[span]
            kept = jnp.sqrt(jnp.maximum(1 - (step / spread[span]) ** 2, 0.0))
            sample(name, rest[span] + kept * (state[name] - rest[span]), jnp.minimum(step, spread[span]))

    return initial, transition


_MIN = 1e-6
"""Variance (in units of that before it was cut off) that rounding leaves."""
_FAR = 12.0
"""Standard deviations beyond which a limit is none."""


class _JointLimits(constraints.interval):  # type: ignore[misc]
    """An interval whose bijector is the identity; bounds may be infinite."""

    def feasible_like(self, prototype: Any) -> Any:
        """The value nearest to 0."""
        return jnp.broadcast_to(jnp.clip(0.0, self.lower_bound, self.upper_bound), jnp.shape(prototype))


@biject_to.register(_JointLimits)  # type: ignore[untyped-decorator]
def _identity(limits: _JointLimits) -> IdentityTransform:
    return IdentityTransform()


class LimitedNormal(dist.Distribution):  # type: ignore[misc]
    """A normal distribution cut off at limits and normalised.

    Args:
        loc: Mean before it is cut off (n,); one beyond a limit counts as at the limit, so that the mass left is a sum of two
            parts, and float32 does.
        scale: Standard deviation before it is cut off, of a shape that broadcasts with it.
        low: Lower limits (n,), -inf for none.
        high: Upper limits (n,).
    """

    arg_constraints: ClassVar = {"loc": constraints.real, "scale": constraints.positive}
    pytree_data_fields = ("loc", "scale", "low", "high")
    reparametrized_params: ClassVar = ["loc", "scale"]

    def __init__(self, loc: Any, scale: Any, low: Any, high: Any, *, validate_args: Any = None) -> None:
        self.low, self.high = jnp.asarray(low, float), jnp.asarray(high, float)
        self.loc = jnp.clip(loc, self.low, self.high)
        shape = jnp.broadcast_shapes(self.loc.shape, jnp.shape(scale))
        self.scale = jnp.broadcast_to(jnp.asarray(scale, float), shape)
        super().__init__(shape, validate_args=validate_args)

    @constraints.dependent_property(is_discrete=False, event_dim=0)  # type: ignore[untyped-decorator]
    def support(self) -> _JointLimits:
        """The limits."""
        return _JointLimits(self.low, self.high)

    def _ends(self) -> tuple[Array, Array]:
        """The limits, in standard deviations from the mean."""
        below, above = (self.loc - self.low) / self.scale, (self.high - self.loc) / self.scale
        return -jnp.minimum(below, _FAR), jnp.minimum(above, _FAR)

    def log_prob(self, value: Array) -> Array:
        """Log-density, -inf beyond the limits."""
        below, above = self._ends()
        mass = 0.5 * (erf(above / np.sqrt(2)) - erf(below / np.sqrt(2)))  # both terms add
        inside = (value >= self.low) & (value <= self.high)
        offset = (jnp.clip(value, self.low, self.high) - self.loc) / self.scale
        density = -0.5 * offset**2 - jnp.log(self.scale * mass) - 0.5 * np.log(2 * np.pi)
        return jnp.where(inside, density, -jnp.inf)

    @property
    def mean(self) -> Array:
        """Mean within the limits."""
        return self.loc + self.scale * self._moments()[0]

    @property
    def variance(self) -> Array:
        """Variance within the limits."""
        first, second = self._moments()
        return self.scale**2 * jnp.maximum(second - first**2, _MIN)

    def _moments(self) -> tuple[Array, Array]:
        """First and second moment about the mean before it was cut off, in standard deviations then."""
        below, above = self._ends()
        mass = 0.5 * (erf(above / np.sqrt(2)) - erf(below / np.sqrt(2)))
        at_low, at_high = (jnp.exp(-0.5 * end**2) / np.sqrt(2 * np.pi) for end in (below, above))
        return (at_low - at_high) / mass, 1 + (below * at_low - above * at_high) / mass

    def sample(self, key: Any, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw; rounding leaves no draw beyond a limit."""
        noise = jax.random.truncated_normal(key, *self._ends(), (*sample_shape, *self.batch_shape))
        return jnp.clip(self.loc + self.scale * noise, self.low, self.high)
