"""A state's sites as one Normal over the flat vector, where all of them are Normal.

A body has a site for each joint. One by one their draws, densities and moments are a dozen small loops each, which take long
to compile and longer to run than one over all coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array

from poseppl.program.execution import unwrap


def joint_normal(names: Mapping[str, Any], trace: Mapping[str, Any]) -> dist.Normal | None:
    """The law of a state (d,) given what its sites depend on; None unless they are Normal, and all that the program samples.

    Args:
        names: The state's sites, in the order of the flat vector.
        trace: Trace of a program.
    """
    sampled = {name: site for name, site in trace.items() if site["type"] == "sample"}
    if set(sampled) != set(names) or not all(is_plain(site, dist.Normal) for site in sampled.values()):
        return None
    flat = [[_flat(sampled[name]["fn"], which) for name in names] for which in ("loc", "scale")]
    return dist.Normal(*(jnp.concatenate(parts) for parts in flat), validate_args=False)


def is_plain(site: Mapping[str, Any], *kinds: type) -> bool:
    """Whether a traced site has a distribution of these very kinds, independent or expanded, neither masked nor scaled."""
    distribution = site["fn"]
    while isinstance(distribution, dist.Independent | dist.ExpandedDistribution):
        distribution = distribution.base_dist
    return type(distribution) in kinds and site.get("scale") is None


def _flat(distribution: dist.Distribution, which: str) -> Array:
    parameter = jnp.asarray(getattr(unwrap(distribution), which), jnp.result_type(float))
    return jnp.ravel(jnp.broadcast_to(parameter, distribution.shape()))
