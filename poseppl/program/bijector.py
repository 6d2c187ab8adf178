"""The bijector of a state: named, constrained sites on one side, one flat unconstrained vector on the other.

    x = (phi_1(s_1), phi_2(s_2), ...),      log p(x) = log p(s) + sum_k log |det d s_k / d x_k|

with phi_k the inverse of NumPyro's `biject_to(support)`, and the identity for real and for circular supports (an angle is
unwrapped: its density is periodic in x) and for discrete sites (rounded to the nearest integer on the way back).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpyro.distributions import biject_to, constraints
from numpyro.distributions.transforms import IdentityTransform

from poseppl.program.execution import base_support

Sites = dict[str, Array]


def is_flat_support(support: Any) -> bool:
    """Whether the bijector of a support is the identity: real and circular ones."""
    base = base_support(support)
    return isinstance(base, type(constraints.real) | type(constraints.circular))


class Site(NamedTuple):
    """One named site of the state.

    Attributes:
        name: Name of the sample site.
        shape: Shape of its constrained value.
        dtype: Its dtype.
        support: Its NumPyro constraint, with concrete bounds.
        discrete: Whether it takes integer or boolean values.
        identity: Whether its bijector is the identity (real, circular or discrete support).
        flat_shape: Shape of the unconstrained value.
        offset: Where it starts in the flat vector.
        size: How many entries it takes there.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    support: Any
    discrete: bool
    identity: bool
    flat_shape: tuple[int, ...]
    offset: int
    size: int

    @property
    def transform(self) -> Any:
        """The map from unconstrained to constrained values."""
        return IdentityTransform() if self.identity else biject_to(self.support)

    @property
    def coordinate_names(self) -> list[str]:
        """Names of its coordinates: `name` for a scalar, else `name[i]` or `name[i,j]`."""
        if not self.flat_shape:
            return [self.name]
        indices = itertools.product(*(range(n) for n in self.flat_shape))
        return [f"{self.name}[{','.join(map(str, index))}]" for index in indices]

    @property
    def circular(self) -> bool:
        """Whether its values are angles, equal where they differ by whole turns."""
        return isinstance(base_support(self.support), type(constraints.circular))

    @property
    def values(self) -> range | None:
        """The integers that it takes, where these are finitely many; None else."""
        bounds = integer_bounds(self.support) if self.discrete else None
        return None if bounds is None else range(bounds[0], bounds[1] + 1)

    def unflatten(self, x: Array) -> Array:
        """Its unconstrained value within a flat vector (d,)."""
        return x[self.offset : self.offset + self.size].reshape(self.flat_shape)


def integer_bounds(support: Any) -> tuple[int, int] | None:
    """Least and largest integer of a support, if it has them."""
    support = base_support(support)
    if isinstance(support, type(constraints.boolean)):
        return 0, 1
    lower, upper = getattr(support, "lower_bound", None), getattr(support, "upper_bound", None)
    if lower is None or upper is None:
        return None
    return int(np.min(np.asarray(lower))), int(np.max(np.asarray(upper)))


def make_site(name: str, shape: tuple[int, ...], dtype: Any, support: Any, discrete: bool, offset: int) -> Site:
    """Lay out one site from `offset` on."""
    identity = discrete or is_flat_support(support)
    flat_shape = shape if identity else tuple(biject_to(support).inverse_shape(shape))
    return Site(name, shape, np.dtype(dtype), support, discrete, identity, flat_shape, offset, math.prod(flat_shape))


def to_sites(sites: Mapping[str, Site], x: Array) -> Sites:
    """Constrained values by name, from a flat vector (d,)."""
    values = {}
    for name, site in sites.items():
        value = site.unflatten(x)
        if site.discrete:
            value = jnp.round(value).astype(site.dtype)
        elif not site.identity:
            value = site.transform(value)
        values[name] = value
    return values


def to_flat(sites: Mapping[str, Site], values: Mapping[str, Array]) -> Array:
    """The flat vector (d,) of constrained values given by name."""
    dtype = jnp.result_type(float)
    parts = []
    for name, site in sites.items():
        value = jnp.asarray(values[name])
        if not site.identity:
            value = site.transform.inv(value)
        parts.append(jnp.ravel(value).astype(dtype))
    return jnp.concatenate(parts) if len(parts) > 1 else parts[0]


def log_det(sites: Mapping[str, Site], x: Array) -> Array:
    """Log-determinant of the map from flat to constrained values, a scalar."""
    total = jnp.zeros((), jnp.result_type(float))
    for site in sites.values():
        if not site.identity:
            value = site.unflatten(x)
            total = total + jnp.sum(site.transform.log_abs_det_jacobian(value, site.transform(value)))
    return total
