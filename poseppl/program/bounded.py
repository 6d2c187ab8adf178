"""A model in the coordinates in which its sites' own supports are bounds: an interval is a box, a half-line is half of one.

The flat state of a compiled model is unconstrained: a site over an interval is seen through a logistic function, in which its
bounds lie at infinity, and the mode of the density is another one. A search for modes under constraints wants the site itself:
here sites of elementwise supports with bounds have their own values in the flat state, all others as before.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.program.bijector import Site
from poseppl.program.compiled import CompiledModel
from poseppl.program.execution import base_support

_MARGIN = 1e-5
"""Share of an interval, or of 1 on a half-line, that a state keeps from the bounds on its way to the unconstrained one."""


class Bounded(NamedTuple):
    """A model in bounded coordinates.

    Attributes:
        model: In its flat state, sites with bounds have their own values; densities are those of that state.
        lower: Bounds of the flat state (d,), -inf where there is none.
        upper: Likewise, inf.
        unbounded: The model that it was made of.
    """

    model: CompiledModel
    lower: np.ndarray[Any, Any]
    upper: np.ndarray[Any, Any]
    unbounded: CompiledModel

    def to_unbounded(self, y: Array, inputs: Any = None) -> Array:
        """The unconstrained flat state (d,) of a bounded one; what lies on a bound is moved inside a little."""
        if np.all(np.isinf(self.lower) & np.isinf(self.upper)):
            return y
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        margin = jnp.maximum(_MARGIN * width, 4 * np.finfo(y.dtype).eps * jnp.abs(y))
        inside = jnp.clip(y, self.lower + margin, self.upper - margin)
        return self.unbounded.to_flat(self.model.to_sites(inside, inputs))


def bounded(model: CompiledModel) -> Bounded:
    """Lay a model out in bounded coordinates.

    Raises:
        ValueError: A discrete site, which has no modes that a gradient leads to.
    """
    lower, upper, sites = [], [], {}
    for name, site in model.sites.items():
        if site.discrete:
            raise ValueError(f"site {name!r} is discrete. Expected continuous sites: searches for modes use gradients.")
        low, high = _bounds(site)
        bounds = np.isfinite(low) | np.isfinite(high)
        sites[name] = site._replace(identity=True) if bounds.any() else site
        lower.append(low)
        upper.append(high)
    return Bounded(dataclasses.replace(model, sites=sites), np.concatenate(lower), np.concatenate(upper), model)


def _bounds(site: Site) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Least and largest values (size,) of a site's entries in the flat state."""
    support = None if site.identity else base_support(site.support)
    low, high = getattr(support, "lower_bound", None), getattr(support, "upper_bound", None)
    elementwise = site.flat_shape == site.shape and (low is not None or high is not None)

    def spread(bound: Any, absent: float) -> np.ndarray[Any, Any]:
        value = absent if bound is None or not elementwise else np.asarray(bound, float)
        return np.broadcast_to(value, site.flat_shape).astype(float).ravel()

    return spread(low, -np.inf), spread(high, np.inf)
