"""The bijector of a state: named, constrained sites on one side, one flat unconstrained vector on the other.

    x = (phi_1(s_1), phi_2(s_2), ...),      log p(x) = log p(s) + sum_k log |det d s_k / d x_k|

with phi_k the inverse of NumPyro's `biject_to(support)`, and the identity for real and for circular supports (an angle is
unwrapped: its density is periodic in x) and for discrete sites (rounded to the nearest integer on the way back).

float32 knows integers up to 2^24 = 16,777,216. A site of larger ones has two coordinates for each entry: the value as float32
rounds it, and the rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from numpyro.distributions import biject_to, constraints
from numpyro.distributions.transforms import IdentityTransform

from poseppl.program.execution import base_support

Sites = dict[str, Array]
LARGEST = 2**24
"""Integers below are exact in float32."""


def is_flat_support(support: Any) -> bool:
    """Whether the bijector of a support is the identity: real and circular ones."""
    base = base_support(support)
    return isinstance(base, type(constraints.real) | type(constraints.circular))


class SplitIntegers:
    """The map from two floats, a rounded integer and the rest, stacked on a leading axis, to the integer.

    Args:
        dtype: The integer's dtype.
    """

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self.dtype = dtype

    def __call__(self, parts: Array) -> Array:
        """The integers (...) of parts (2, ...)."""
        rounded, rest = jnp.round(parts)
        value: Array = rounded.astype(self.dtype) + rest.astype(jnp.int32).astype(self.dtype)
        return value

    def inv(self, value: Array) -> Array:
        """The parts (2, ...) of integers (...)."""
        dtype, largest = jnp.result_type(float), np.iinfo(self.dtype).max
        least = float(np.nextafter(np.asarray(largest, dtype), np.asarray(0, dtype)))  # rounded up, it would be no integer
        rounded = jnp.minimum(value.astype(dtype), least)
        rest = (value - rounded.astype(self.dtype)).astype(jnp.int32)
        return jnp.stack([rounded, rest.astype(dtype)])


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
        offset: Its start in the flat vector.
        size: How many entries it takes there.
        split: Whether it takes integers beyond 2^24, in two coordinates for each entry.
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
    split: bool = False

    @property
    def transform(self) -> Any:
        """The map from unconstrained to constrained values."""
        if self.split:
            return SplitIntegers(self.dtype)
        return IdentityTransform() if self.identity else biject_to(self.support)

    @property
    def coordinate_names(self) -> list[str]:
        """Names of its coordinates: `name` for a scalar, else `name[i]` or `name[i,j]`; the second ones end in ` (rest)`."""
        indices = itertools.product(*(range(n) for n in (self.shape if self.split else self.flat_shape)))
        names = [f"{self.name}[{','.join(map(str, index))}]" if index else self.name for index in indices]
        return names + [f"{name} (rest)" for name in names] if self.split else names

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


def laid_out(sites: Mapping[str, Site], split: Collection[str]) -> dict[str, Site]:
    """The sites one after the other, those of the names `split` with two coordinates for each entry."""
    placed: dict[str, Site] = {}
    offset = 0
    for name, site in sites.items():
        if site.discrete:
            shape = (2, *site.shape) if name in split else site.shape
            site = site._replace(identity=name not in split, split=name in split, flat_shape=shape, size=math.prod(shape))
        placed[name] = site._replace(offset=offset)
        offset += site.size
    return placed


def unsafe_integers(sites: Mapping[str, Site]) -> list[str]:
    """Names of integer sites of one coordinate an entry whose bounds, if any, are beyond what floats know."""
    if jnp.result_type(float) != jnp.float32:
        return []
    bounds = {name: integer_bounds(site.support) for name, site in sites.items() if site.discrete and not site.split}
    return [name for name, ends in bounds.items() if ends is None or max(map(abs, ends)) >= LARGEST]


def to_sites(sites: Mapping[str, Site], x: Array) -> Sites:
    """Constrained values by name, from a flat vector (d,)."""
    values = {}
    for name, site in sites.items():
        value = site.unflatten(x)
        if site.discrete and not site.split:
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
        if not site.identity and not site.discrete:
            value = site.unflatten(x)
            total = total + jnp.sum(site.transform.log_abs_det_jacobian(value, site.transform(value)))
    return total
