"""The bijector of what does not change over time: params by name on one side, one flat unconstrained vector u on the other.

    log p(u) = log p(params) + log |det d params / d u|

with the bijections of :mod:`poseppl.program.bijector`: log for positive params, the logit for fractions, the identity on
the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from jax import Array

from poseppl.program import bijector
from poseppl.program.bijector import Site, make_site
from poseppl.program.compiled import CompiledModel
from poseppl.program.memoized_builder import memoized_builder
from poseppl.program.schema import declare


class ParameterBijector(NamedTuple):
    """The sites of a parameters program, laid out in one flat vector.

    Attributes:
        sites: The sites by name.
    """

    sites: dict[str, Site]

    @property
    def dimension(self) -> int:
        """Length p of the flat vector."""
        return sum(site.size for site in self.sites.values())

    @property
    def coordinate_names(self) -> tuple[str, ...]:
        """Names of the p coordinates, `noise` or `lengths[0]`."""
        return tuple(name for site in self.sites.values() for name in site.coordinate_names)

    def to_params(self, u: Array) -> dict[str, Array]:
        """Constrained values by name, from u (p,)."""
        return bijector.to_sites(self.sites, u)

    def to_flat(self, params: Mapping[str, Any]) -> Array:
        """The flat vector (p,) of constrained values given by name."""
        return bijector.to_flat(self.sites, params)

    def log_det(self, u: Array) -> Array:
        """Log-determinant of the map from u to the params, a scalar."""
        return bijector.log_det(self.sites, u)

    def log_prior(self, model: CompiledModel, u: Array) -> Array:
        """Log-density of u (p,) under the model's parameters program, a scalar."""
        return model.log_parameters(self.to_params(u)) + self.log_det(u)


@memoized_builder
def parameter_bijector(model: CompiledModel) -> ParameterBijector:
    """Lay out a model's params.

    Raises:
        ValueError: The model has no parameters program, or a site of it is discrete, is given `obs=`, or has a support that
            depends on another site.
    """
    program = model.programs.parameters
    if program is None:
        raise ValueError("The model has no parameters program: give StateSpaceModel(parameters=...).")
    sites: dict[str, Site] = {}
    offset = 0
    for name, declared in declare("parameters", program, ()).sites.items():
        if declared.observed or declared.kind != "float":
            raise ValueError(
                f"Site {name!r} of the parameters program is {declared.kind}, or has obs=. Expected a float to learn."
            )
        if declared.support is None:
            raise ValueError(
                f"The support of site {name!r} in the parameters program depends on another site. Expected constant bounds: "
                "sample an unbounded or unit-interval value and map it in the programs that use it."
            )
        sites[name] = make_site(name, declared.shape, declared.dtype, declared.support, False, offset)
        offset += sites[name].size
    return ParameterBijector(sites)
