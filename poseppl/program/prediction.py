"""Data drawn from the observation program, with their moments given the state, as flat vectors.

Some likelihoods are not predictive. Heuristic likelihoods (`numpyro.factor`), powers of densities (`handlers.scale`), densities
that the program masks (`handlers.mask`) and distributions that find their data in their own arguments (attribute
``is_predictive`` False) predict nothing. They measure how well a state explains the data, not which data it would generate.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array

from poseppl.program.execution import is_factor, is_masked


class DrawnData(NamedTuple):
    """Data of a frame given a state, the sites in order.

    Attributes:
        sites: A draw by site.
        values: The draw (k,).
        mean: Its mean (k,); NaN if the distribution does not provide it.
        variance: Its variance (k,); NaN if the distribution does not provide it.
    """

    sites: dict[str, Array]
    values: Array
    mean: Array
    variance: Array


def drawn_data(sites: Mapping[str, Any], trace: Mapping[str, Any]) -> DrawnData:
    """Read data off the seeded trace of an observation program.

    Args:
        sites: The observation's sites.
        trace: The trace.

    Raises:
        ValueError: The program predicts nothing.
    """
    obstacle = why_not_predictive(trace)
    if obstacle is not None:
        raise ValueError(f"The observation program predicts no data: {obstacle}.")
    drawn = {name: jnp.asarray(trace[name]["value"]) for name in sites}
    return DrawnData(drawn, *(jnp.concatenate(parts) for parts in zip(*(_of_site(trace[name]) for name in sites), strict=True)))


def why_not_predictive(trace: Mapping[str, Any]) -> str | None:
    """Why no data can be drawn from an observation program, or None when they can."""
    for name, site in trace.items():
        if site["type"] != "sample":
            continue
        if is_factor(site):
            return f"{name!r} is a factor, a heuristic likelihood"
        if site.get("scale") is not None:
            return f"the density of site {name!r} is scaled"
        if is_masked(site["fn"]):
            return f"the program masks site {name!r} itself (leave the mask out, with NaN for the data that it hides)"
        if not getattr(site["fn"], "is_predictive", True):
            return f"the {type(site['fn']).__name__} of site {name!r} are a heuristic likelihood"
    return None


def _of_site(site: Mapping[str, Any]) -> tuple[Array, Array, Array]:
    distribution, values = site["fn"], jnp.asarray(site["value"])
    moments = (_moment(distribution, which, values.shape) for which in ("mean", "variance"))
    mean, variance = moments
    return jnp.ravel(values).astype(mean.dtype), mean, variance


def _moment(distribution: dist.Distribution, which: str, shape: tuple[int, ...]) -> Array:
    try:
        moment = jnp.asarray(getattr(distribution, which), jnp.result_type(float))
    except NotImplementedError:
        moment = jnp.full((), jnp.nan)
    return jnp.ravel(jnp.broadcast_to(moment, shape))
