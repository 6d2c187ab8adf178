"""Which integer sites of a state are too large for float32, in which the flat state is computed.

The supports do not show this: a Poisson has no upper bound. So a first state is made when a model is compiled, each site at its
mean or, where its distribution gives none, at a draw. Sites that are large there get two coordinates for each entry
(:class:`poseppl.program.bijector.SplitIntegers`). Others may still grow beyond 2^24, and the drivers of runs look for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jax import Array

from poseppl.compilation import compile_to_run_once, jit
from poseppl.errors import PosepplError
from poseppl.program.bijector import LARGEST, Site, laid_out, unsafe_integers
from poseppl.program.execution import Program, trace_program

_LARGE = 2**20
"""First values from which a site gets two coordinates."""


def with_large_integers(sites: Mapping[str, Site], initial: Program, params: Any, inputs: Any) -> dict[str, Site]:
    """The layout of a state, in which sites that are large in a first state of zero inputs have two coordinates.

    Args:
        sites: The state's sites.
        initial: The initial program.
        params: Its params.
        inputs: Its inputs, of which the shapes count.
    """
    candidates = unsafe_integers(sites)
    if not candidates or any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(params)):
        return dict(sites)

    def first(inputs: Any) -> dict[str, Array]:
        trace = trace_program(initial, (params, inputs), values=partial(_expected, sites))
        return {name: jnp.max(jnp.abs(trace[name]["value"]), initial=0) for name in candidates}

    zeros = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), inputs)
    with jax.ensure_compile_time_eval(), numpyro.validation_enabled(False):  # zeros need be no scales or probabilities
        largest = compile_to_run_once(jit(first).lower(zeros), num_particles=1, num_numbers=1)(zeros)
    return laid_out(sites, [name for name, value in largest.items() if value >= _LARGE])


def _expected(sites: Mapping[str, Site], message: Mapping[str, Any]) -> Array | None:
    """The mean of a site, rounded where it takes integers; None where its distribution gives none."""
    site = sites.get(message["name"])
    if message["type"] != "sample" or site is None:
        return None
    try:
        mean = jnp.broadcast_to(message["fn"].mean, site.shape)
    except (NotImplementedError, ValueError):
        return None
    known = jnp.where(jnp.isfinite(mean), mean, 0)
    return (jnp.round(known) if site.discrete else known).astype(site.dtype)


def are_exact(sites: Mapping[str, Site], states: Array) -> Array:
    """Whether all integers of each flat state (..., d) are exact (...)."""
    exact = jnp.ones(states.shape[:-1], bool)
    for name in unsafe_integers(sites):
        site = sites[name]
        exact &= jnp.all(jnp.abs(states[..., site.offset : site.offset + site.size]) < LARGEST, -1)
    return exact


def overflown(sites: Mapping[str, Site], states: Any) -> list[str]:
    """Names of the integer sites that some of the flat states (..., d) do not represent exactly."""
    names = unsafe_integers(sites)
    if not names or isinstance(states, jax.core.Tracer):  # of which nothing is known yet
        return []
    flat = np.asarray(states)
    spans = {name: flat[..., sites[name].offset : sites[name].offset + sites[name].size] for name in names}
    return [name for name, values in spans.items() if np.any(np.abs(values) >= LARGEST)]


def check_exact(sites: Mapping[str, Site], states: Any) -> None:
    """Refuse flat states (..., d) whose integers are not exact.

    Raises:
        PosepplError: It names the sites.
    """
    names = overflown(sites, states)
    if names:
        raise PosepplError(overflow_message(names))


def overflow_message(names: list[str]) -> str:
    """The remedy."""
    listed = ", ".join(map(repr, names))
    return (
        f"integers of site {listed} reach 2^24 = {LARGEST}, from where float32 loses units. Call "
        "jax.config.update('jax_enable_x64', True) first, or let the first frame be as large, so that the site gets two "
        "coordinates"
    )
