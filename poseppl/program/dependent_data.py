"""Data sites that depend on one another within a frame, of which some may be missing.

    y1 ~ Normal(x, 0.5),    y2 ~ Normal(y1, 0.3).

If y1 is missing, the density of y2 is its marginal: y1 has to be integrated out. Sites that depend on each other form a group.
A group is Gaussian if all its sites are Normal or MultivariateNormal, their means are affine in the group's other sites, and
their scales do not depend on them. Its joint moments follow as those of a state do (:mod:`poseppl.program.state_moments`), and
its density is that of the entries that were seen. In any other group a site can be evaluated only if all its parents were seen:
:func:`check_parents_seen` refuses other data. A latent site of the observation program is one that is always missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array
from jax.scipy.linalg import solve_triangular
from numpyro.distributions import constraints

from poseppl.errors import UnsuitableModelError
from poseppl.program.bijector import Site, make_site
from poseppl.program.execution import Trace, Values, site_log_density
from poseppl.program.normal_sites import is_plain
from poseppl.program.observation import Observation
from poseppl.program.partly_seen import entry_log_densities, seen_factor
from poseppl.program.schema import Declared
from poseppl.program.state_moments import TraceOf, chained_moments, moments_form, same_frame_dependence


class DependentData(NamedTuple):
    """How the data sites of a model depend on one another.

    Attributes:
        parents: The sites that each site depends on; sites without any are left out.
        gaussian: The Gaussian groups, each in the order of the sites.
        obstacles: Why each other group is not Gaussian, by the names of its sites.
    """

    parents: Mapping[str, list[str]]
    gaussian: tuple[tuple[str, ...], ...]
    obstacles: Mapping[str, str]


def dependent_data(sites: Mapping[str, Declared], trace_of: TraceOf) -> DependentData | None:
    """Find how data sites depend on one another; None if they do not.

    Args:
        sites: The data sites.
        trace_of: Trace of the observation program, at any state, given values of its sites.
    """
    if len(sites) < 2:
        return None
    laid_out = _laid_out(sites, tuple(sites))
    depends = same_frame_dependence(laid_out, trace_of)
    parents = {name: [other for other in others if other != name] for name, others in depends.items()}
    parents = {name: others for name, others in parents.items() if others}
    if not parents:
        return None
    gaussian: list[tuple[str, ...]] = []
    obstacles: dict[str, str] = {}
    for group in _groups(tuple(sites), parents):
        obstacle = _obstacle(sites, group, trace_of)
        if obstacle is None:
            gaussian.append(group)
        else:
            obstacles |= dict.fromkeys(group, obstacle)
    return DependentData(parents, tuple(gaussian), obstacles)


def check_parents_seen(sites: Mapping[str, Declared], dependent: DependentData, mask: Mapping[str, Any]) -> None:
    """Refuse data of a site that depends on a missing one which cannot be integrated out.

    Args:
        sites: The data sites.
        dependent: How they depend on one another.
        mask: The data, of one frame or with a leading T.

    Raises:
        ValueError: There are such data; the message names both sites.
    """
    for name, others in dependent.parents.items():
        if name not in dependent.obstacles:
            continue
        for other in others:
            child, parent = (np.asarray(mask[each]).reshape(-1, sites[each].size) for each in (name, other))
            if np.any(child.any(1) & ~parent.all(1)):
                raise ValueError(
                    f"Observation {name!r} is given where {other!r}, which it depends on in the same frame, is missing, and "
                    f"{other!r} cannot be integrated out: {dependent.obstacles[name]}. Give {other!r}, mask {name!r} as well "
                    "(NaN), or write one site with the distribution of the observed data."
                )


def log_density_of_seen(sites: Mapping[str, Declared], dependent: DependentData, trace_of: TraceOf, data: Observation) -> Array:
    """Log-density of a frame's data, a scalar, with missing sites of Gaussian groups integrated out."""
    trace, together = trace_of(data.values), {name for group in dependent.gaussian for name in group}
    total = jnp.zeros((), jnp.result_type(float))
    for name, site in trace.items():
        if site["type"] == "sample" and name not in together:
            total = total + site_log_density(site, data.mask.get(name))
    for group in dependent.gaussian:
        total = total + jnp.sum(_entries(sites, group, trace_of, data))
    return total


def log_densities_of_events(
    sites: Mapping[str, Declared], dependent: DependentData, trace_of: TraceOf, data: Observation
) -> dict[str, Array]:
    """For each site in a Gaussian group, the log-density of its events, given the seen ones before them."""
    found = {}
    for group in dependent.gaussian:
        laid_out, entries = _laid_out(sites, group), _entries(sites, group, trace_of, data)
        for name, site in laid_out.items():
            values = site.unflatten(entries)
            found[name] = jnp.sum(values, tuple(range(values.ndim - sites[name].event_dim, values.ndim)))
    return found


def moments_of_data(sites: Mapping[str, Declared], dependent: DependentData, trace_of: TraceOf) -> tuple[Array, Array]:
    """Mean (k,) and covariance (k, k) of a frame's data, all sites in order.

    Raises:
        UnsuitableModelError: They have none.
    """
    laid_out = _laid_out(sites, tuple(sites))
    obstacle = _not_normal(trace_of, tuple(sites)) or moments_form(laid_out, trace_of).obstacle
    if obstacle is not None:
        raise UnsuitableModelError(
            f"The observation program has no Gaussian moments: {obstacle}. Use an algorithm that evaluates the likelihood "
            "(particle, tempered or HMC filters)."
        )
    return chained_moments(laid_out, trace_of)


def group_moments(
    sites: Mapping[str, Declared], group: tuple[str, ...], trace_of: TraceOf, others: Mapping[str, Array]
) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of a Gaussian group, with the values of the other sites given."""
    return chained_moments(_laid_out(sites, group), _around(trace_of, group, others))


def information_of_group(
    sites: Mapping[str, Declared],
    group: tuple[str, ...],
    trace_at: Callable[[Array], TraceOf],
    x: Array,
    data: Observation,
) -> Array:
    """Gauss-Newton curvature (d, d) of -log p of what was seen of a Gaussian group, by the state `x` (d,)."""
    _, covariance = group_moments(sites, group, trace_at(x), data.values)
    jacobian = jax.jacrev(lambda state: group_moments(sites, group, trace_at(state), data.values)[0])(x)
    seen = jnp.concatenate([jnp.ravel(data.mask[name]) for name in group])
    white = solve_triangular(seen_factor(covariance, seen), jnp.where(seen[:, None], jacobian, 0.0), lower=True)
    return white.T @ white


def _entries(sites: Mapping[str, Declared], group: tuple[str, ...], trace_of: TraceOf, data: Observation) -> Array:
    """Log-densities (n,) of the entries of a Gaussian group, one given those before it."""
    mean, covariance = group_moments(sites, group, trace_of, data.values)
    values, seen = (jnp.concatenate([jnp.ravel(part[name]) for name in group]) for part in data)
    return entry_log_densities(values.astype(mean.dtype) - mean, covariance, seen)


def _laid_out(sites: Mapping[str, Declared], names: tuple[str, ...]) -> dict[str, Site]:
    """Data sites as coordinates of one flat vector."""
    found: dict[str, Site] = {}
    offset = 0
    for name in names:
        declared = sites[name]
        found[name] = make_site(name, declared.shape, declared.dtype, constraints.real, declared.kind != "float", offset)
        offset += found[name].size
    return found


def _around(trace_of: TraceOf, group: tuple[str, ...], others: Mapping[str, Array]) -> TraceOf:
    """The trace of a group's sites alone, given their values, with those of the others fixed."""

    def trace(values: Values) -> Trace:
        def value(message: Mapping[str, Any]) -> Array | None:
            name = message["name"]
            if name not in group:
                return others.get(name)
            return values(message) if callable(values) else values[name]

        return {name: site for name, site in trace_of(value).items() if name in group}

    return trace


def _groups(names: tuple[str, ...], parents: Mapping[str, list[str]]) -> list[tuple[str, ...]]:
    """The sites that hang together, in order; sites that stand alone are left out."""
    groups = [{name, *others} for name, others in parents.items()]
    merged: list[set[str]] = []
    for group in groups:
        touching = [other for other in merged if other & group]
        merged = [other for other in merged if not other & group] + [group.union(*touching)]
    return [tuple(name for name in names if name in group) for group in merged]


def _obstacle(sites: Mapping[str, Declared], group: tuple[str, ...], trace_of: TraceOf) -> str | None:
    """Why a group is not Gaussian, or None."""
    found = _not_normal(trace_of, group) or _read_by_factor(sites, group, trace_of)
    if found is not None:
        return found
    zeros = {name: jnp.zeros(site.shape, site.dtype) for name, site in sites.items() if name not in group}
    form = moments_form(_laid_out(sites, group), _around(trace_of, group, zeros))
    return form.obstacle or ("a mean is not affine in what it depends on" if form.linearised else None)


def _not_normal(trace_of: TraceOf, group: tuple[str, ...]) -> str | None:
    """The first site that is no plain Normal or MultivariateNormal, as an obstacle."""
    found: list[str] = []

    def look() -> None:
        trace = trace_of({})
        found.extend(name for name in group if not is_plain(trace[name], dist.Normal, dist.MultivariateNormal))

    jax.eval_shape(look)
    return f"{found[0]!r} is no Normal or MultivariateNormal" if found else None


def _read_by_factor(sites: Mapping[str, Declared], group: tuple[str, ...], trace_of: TraceOf) -> str | None:
    """The first site of a group whose value a factor reads, as an obstacle."""
    laid_out = _laid_out(sites, tuple(sites))
    read = same_frame_dependence(laid_out, trace_of, factors=True)
    for name, others in read.items():
        for other in others:
            if name not in sites and other in group:
                return f"the factor {name!r} reads {other!r}"
    return None
