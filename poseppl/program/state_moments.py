"""Gaussian moments of a frame's flat state, from the distributions of the program that samples it.

If no site depends on another of its frame, these are the moments of the single sites. A site whose mean depends on sites
that were sampled before it makes a chain: with the conditional mean m_k and covariance S_k of each site's coordinates,

    x_k = m_k(x_1, ..., x_(k-1)) + e_k,      Cov(e_k) = S_k,      so that x = g(e_1, e_2, ...),

and the frame has the mean g(0) and the covariance J diag(S_1, S_2, ...) J^T with J = dg / de at 0. That is exact where every
m_k is affine. Otherwise it is linearised about the mean, which :attr:`MomentsForm.linearised` says. A covariance S_k
that depends on a site of its frame is refused.

The flat coordinates of a site with bounds are Gaussian where it is a Normal seen through its own bijector: the logarithm of a
LogNormal has the moments of that Normal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array
from numpyro.distributions import biject_to

from poseppl.program.bijector import Site
from poseppl.program.dependence import output_dependence
from poseppl.program.execution import Values, base_support, sample_sites, unwrap
from poseppl.program.moments import joint_moments, moments
from poseppl.program.normal_sites import joint_normal

TraceOf = Callable[[Values], dict[str, dict[str, Any]]]
"""Trace of the initial or the transition program given the values of its sites."""


class MomentsForm(NamedTuple):
    """How the moments of a program are found.

    Attributes:
        obstacle: Why there are none, or None.
        chained: Whether a site's mean depends on another site of the same frame.
        linearised: Whether such a mean is not affine. This is read from its derivative: loops and branches count as not
            affine, and so do logarithms of positive sites; steps (`jnp.round`), whose derivative is 0, as affine.
    """

    obstacle: str | None = None
    chained: bool = False
    linearised: bool = False


def moments_form(sites: Mapping[str, Site], trace_of: TraceOf) -> MomentsForm:
    """Read from a program how the moments of its flat state are found; nothing is computed."""
    for name, site in sites.items():
        if site.discrete:
            return MomentsForm(f"site {name!r} is not over the real line (support {site.support})")
    failures: list[str] = []

    def parts(name: str, site: Mapping[str, Any]) -> dict[Any, Any]:
        try:
            mean, spread = _flat_moments(sites[name], site["fn"])
        except (ValueError, NotImplementedError) as error:
            failures.append(f"site {name!r}: {str(error) or 'its distribution gives no mean and variance'}")
            return {}
        return {(name, "mean"): mean, (name, "scale"): spread}

    depends = _dependence(sites, trace_of, parts)
    for (name, what), others in depends.items():
        if others and (what == "scale" or name in others):
            return MomentsForm(f"the {what} of site {name!r} depends on site {others[0]!r} of the same frame")
    if failures:
        return MomentsForm(failures[0])
    chained = any(depends.values())
    return MomentsForm(None, chained, chained and _bends(sites, trace_of))


def same_frame_dependence(sites: Mapping[str, Site], trace_of: TraceOf, *, factors: bool = False) -> dict[str, list[str]]:
    """For each site, or besides for each factor, the sites of its own frame that its distribution depends on."""
    return _dependence(sites, trace_of, lambda name, site: {name: site["fn"]}, factors)


def state_moments(sites: Mapping[str, Site], trace_of: TraceOf, form: MomentsForm) -> tuple[Array, Array]:
    """Mean (d,) and covariance (d, d) of the flat state, of a program whose form has no obstacle."""
    if form.chained:
        return chained_moments(sites, trace_of)
    trace = sample_sites(trace_of({name: jnp.zeros(site.shape, site.dtype) for name, site in sites.items()}))
    joint = joint_normal(sites, trace)
    if joint is not None:
        return joint.loc, jnp.diag(jnp.where(joint.scale < 0, jnp.nan, jnp.square(joint.scale)))
    return joint_moments([_flat_moments(site, trace[name]["fn"]) for name, site in sites.items()])


def _flat_moments(site: Site, distribution: dist.Distribution) -> tuple[Array, Array]:
    """The :func:`~poseppl.program.moments.moments` of a site's coordinates.

    Raises:
        ValueError: They are not known.
    """
    if site.identity:
        return moments(distribution)
    base = unwrap(distribution)
    through = isinstance(base, dist.TransformedDistribution) and base.transforms == [biject_to(base_support(site.support))]
    if not through or not isinstance(unwrap(base.base_dist), dist.Normal | dist.MultivariateNormal):
        raise ValueError(f"not over the real line (support {site.support}), nor a Normal seen through its bijector")
    return moments(base.base_dist, site.flat_shape)


def _dependence(
    sites: Mapping[str, Site],
    trace_of: TraceOf,
    parts_of: Callable[[str, Mapping[str, Any]], Mapping[Any, Any]],
    factors: bool = False,
) -> dict[Any, list[str]]:
    """For each part (a tree of arrays) that describes a traced site, the sites that it depends on."""
    counts: dict[Any, int] = {}

    def leaves(values: dict[str, Array]) -> list[Any]:
        found = []
        trace = trace_of(values)
        sampled = {name: site for name, site in trace.items() if site["type"] == "sample"} if factors else sample_sites(trace)
        for name, site in sampled.items():
            for key, part in parts_of(name, site).items():
                parts = [leaf for leaf in jax.tree.leaves(part) if isinstance(leaf, Array | np.ndarray | float | int)]
                counts[key] = len(parts)
                found += parts
        return found

    example = {name: jnp.zeros(site.shape, site.dtype) for name, site in sites.items()}
    names = sorted(example)
    closed = jax.make_jaxpr(leaves)(example)
    reached = iter(output_dependence(closed, [frozenset({names.index(name)}) for name in names]))
    numbers = {key: set().union(*[next(reached) for _ in range(count)]) for key, count in counts.items()}
    return {key: [names[number] for number in sorted(others)] for key, others in numbers.items()}


def _chain(sites: Mapping[str, Site], trace_of: TraceOf, deviation: Array) -> tuple[Array, list[tuple[Array, Array]]]:
    """The flat state g(e) at deviations e (d,) from the conditional means, and the conditional moments of its sites."""
    found: dict[str, tuple[Array, Array]] = {}

    def value(message: Mapping[str, Any]) -> Array | None:
        if message["type"] != "sample":
            return None
        site = sites[message["name"]]
        found[site.name] = mean, _ = _flat_moments(site, message["fn"])
        moved: Array = site.transform((mean + jnp.ravel(site.unflatten(deviation))).reshape(site.flat_shape))
        return moved.astype(site.dtype)

    trace_of(value)
    mean = jnp.concatenate([found[name][0] for name in sites])
    return mean + deviation, [found[name] for name in sites]


def chained_moments(sites: Mapping[str, Site], trace_of: TraceOf) -> tuple[Array, Array]:
    """Mean (d,) and covariance (d, d) of sites that may depend on one another."""
    nothing = _no_deviation(sites)
    mean, pull, parts = jax.vjp(lambda deviation: _chain(sites, trace_of, deviation), nothing, has_aux=True)
    (jacobian,) = jax.vmap(pull)(jnp.eye(len(nothing), dtype=nothing.dtype))
    covariance = jacobian @ joint_moments(parts)[1] @ jacobian.T
    return mean, (covariance + covariance.T) / 2


def _bends(sites: Mapping[str, Site], trace_of: TraceOf) -> bool:
    """Whether the derivative of a chain depends on where it is taken."""
    jacobian = jax.jacrev(lambda deviation: _chain(sites, trace_of, deviation)[0])
    return any(output_dependence(jax.make_jaxpr(jacobian)(_no_deviation(sites)), [frozenset({0})]))


def _no_deviation(sites: Mapping[str, Site]) -> Array:
    return jnp.zeros(sum(site.size for site in sites.values()), jnp.result_type(float))
