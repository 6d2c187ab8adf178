"""Transitions of stochastic differential equations, dx = f(x) dt + g(x) dW, by a step in time.

    Euler-Maruyama    x + f dt + g dW                                   dW ~ N(0, dt)
    Milstein          x + f dt + g dW + (g g' / 2) (dW^2 - dt)          each entry with noise of its own

Both have a density, so that every algorithm takes them. Strong errors fall with dt^(1/2) and dt, weak ones with dt (Kloeden and
Platen 1992, chapters 10 and 14, doi:10.1007/978-3-662-12616-5). :func:`poseppl.program.substeps.with_substeps` takes smaller
steps than the frames' distance:

    step = euler_maruyama(drift, diffusion, lambda inputs: inputs["dt"] / 8)
    programs = with_substeps(StateSpaceModel(initial, step, observation), 8)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpyro
import numpyro.distributions as dist
from jax import Array
from jax.flatten_util import ravel_pytree
from numpyro.distributions import constraints

Field = Callable[[Any, dict[str, Array], Any], Mapping[str, Any]]
"""`(params, state, inputs) -> value by site`: what a drift and a diffusion are."""
Step = float | Callable[[Any], Any]
"""The step in time, or a function of the frame's inputs that gives it."""


def euler_maruyama(drift: Field, diffusion: Field, step: Step) -> Callable[..., None]:
    """The transition program of an Euler-Maruyama step.

    Args:
        drift: f by site, in units of the site a unit of time.
        diffusion: g by site, in units of the site a root of a unit of time: of the site's shape (or a scalar) where each entry
            has noise of its own; for a vector (d,) also a matrix (d, m), with a regular g g^T, of m shared noises.
        step: dt, at least 0.
    """

    def transition(params: Any, state: dict[str, Array], inputs: Any) -> None:
        dt, spreads = _step(step, inputs), diffusion(params, state, inputs)
        for name, slope in drift(params, state, inputs).items():
            mean, spread = state[name] + slope * dt, jnp.asarray(spreads[name])
            if spread.ndim == mean.ndim + 1:
                numpyro.sample(name, dist.MultivariateNormal(mean, spread @ spread.T * dt))
            else:
                numpyro.sample(name, dist.Normal(mean, jnp.broadcast_to(spread * jnp.sqrt(dt), mean.shape)))

    return transition


def milstein(drift: Field, diffusion: Field, step: Step) -> Callable[..., None]:
    """The transition program of a Milstein step, for noise of its own in each entry.

    Args:
        drift: f by site, as :func:`euler_maruyama` takes it.
        diffusion: g by site, of the site's shape; an entry may depend on itself. If it depends on another, the state is NaN.
        step: dt, at least 0.
    """

    def transition(params: Any, state: dict[str, Array], inputs: Any) -> None:
        dt = _step(step, inputs)
        slopes = drift(params, state, inputs)
        x, unravel = ravel_pytree({name: state[name] for name in slopes})

        def spread(x: Array) -> Array:
            moved = unravel(x)
            found = diffusion(params, {**state, **moved}, inputs)
            return ravel_pytree({name: jnp.broadcast_to(found[name], jnp.shape(value)) for name, value in moved.items()})[0]

        jacobian = jax.jacfwd(spread)(x)
        own = jnp.diagonal(jacobian)
        own = jnp.where(jnp.all(jacobian == jnp.diag(own)), own, jnp.nan)  # cross terms would need the area of two noises
        spreads, bends = unravel(spread(x) * jnp.sqrt(dt)), unravel(0.5 * spread(x) * own * dt)
        for name, slope in slopes.items():
            numpyro.sample(name, MilsteinStep(state[name] + slope * dt, spreads[name], bends[name]))

    return transition


def _step(step: Step, inputs: Any) -> Any:
    return step(inputs) if callable(step) else step


class MilsteinStep(dist.Distribution):  # type: ignore[misc]
    """The law of loc + scale Z + bend (Z^2 - 1), Z standard normal.

    Args:
        loc: Mean.
        scale: Standard deviation of the linear part, not 0.
        bend: Coefficient of the quadratic part; with 0 it is a Normal.
    """

    arg_constraints = {"loc": constraints.real, "scale": constraints.real, "bend": constraints.real}
    reparametrized_params = ["loc", "scale", "bend"]
    support = constraints.real

    def __init__(self, loc: Any, scale: Any, bend: Any) -> None:
        self.loc, self.scale, self.bend = jnp.broadcast_arrays(*map(jnp.asarray, (loc, scale, bend)))
        super().__init__(self.loc.shape, validate_args=False)

    def sample(self, key: Array, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draws."""
        z = jax.random.normal(key, (*sample_shape, *self.batch_shape))
        return self.loc + self.scale * z + self.bend * (z**2 - 1)

    def log_prob(self, value: Any) -> Array:
        """Log-density: over both roots z of N(z) / |scale + 2 bend z|; -inf beyond the values that are reached."""
        offset = self.loc - self.bend - value
        discriminant = self.scale**2 - 4 * self.bend * offset
        reached = discriminant > 0
        root = jnp.sqrt(jnp.where(reached, discriminant, 1.0))
        sign = jnp.where(self.scale < 0, -1.0, 1.0)
        # the near root in a form that is exact for a small bend; the far one goes to infinity
        half = self.scale + sign * root
        near = -2 * offset / half
        flat = self.bend == 0
        far = -half / (2 * jnp.where(flat, 1.0, self.bend))
        terms = [-0.5 * near**2, jnp.where(flat, -jnp.inf, -0.5 * far**2)]
        total = jnp.logaddexp(*terms) - jnp.log(root) - 0.5 * jnp.log(2 * jnp.pi)
        return jnp.where(reached, total, -jnp.inf)

    @property
    def mean(self) -> Array:
        """The mean, `loc`."""
        return self.loc

    @property
    def variance(self) -> Array:
        """The variance, scale^2 + 2 bend^2."""
        return self.scale**2 + 2 * self.bend**2
