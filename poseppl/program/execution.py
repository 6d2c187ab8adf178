"""Run one NumPyro program as a pure function: draw its sites, or sum their log-densities.

Every run is closed off from whatever handlers surround the call (`handlers.block`), so that a filter used inside another
NumPyro program neither leaks its sites into that program nor picks up its scales, masks and seeds. Tracing costs nothing
under `jax.jit`; outside it a run takes tens of milliseconds.

For a program with sample sites s, distributions p_s, scales w_s (`handlers.scale`) and masks m_s,

    log p = sum over s of sum(w_s * m_s * log p_s(value_s)),

where a `numpyro.factor` site counts its factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from numpyro import handlers
from numpyro.distributions import constraints
from numpyro.distributions.distribution import Unit

from poseppl.program.closed_forms import SummedDensity
from poseppl.program.explanation import refuse

_WIDTH = 4
"""Entries of a site up to which its normal draws come from a table of all sites."""

Program = Callable[..., Any]
Trace = dict[str, dict[str, Any]]


def unwrap(distribution: dist.Distribution) -> dist.Distribution:
    """The distribution inside Independent, Masked and Expanded wrappers."""
    while isinstance(distribution, dist.Independent | dist.MaskedDistribution | dist.ExpandedDistribution):
        distribution = distribution.base_dist
    return distribution


def base_support(support: Any) -> Any:
    """The elementwise constraint inside `independent` wrappers."""
    while isinstance(support, type(constraints.independent(constraints.unit_interval, 1))):
        support = support.base_constraint
    return support


def is_factor(site: Mapping[str, Any]) -> bool:
    """Whether a traced site comes from `numpyro.factor`."""
    return site["type"] == "sample" and isinstance(unwrap(site["fn"]), Unit)


class Seed(handlers.seed):  # type: ignore[misc]
    """Hand out keys from one split of all that a program needs; NumPyro's own seed splits twice as often.

    Random bits are what a particle filter spends most of its time on, so a program of one site gets its key unsplit. They are
    also what a program of many sites takes longest to compile: small Normal sites get, of one table, what each would draw with
    its own key, for with JAX's generator the first draws of a key do not depend on their number.

    Args:
        rng_key: The key to split.
        num_keys: How many keys the program needs; None splits as it goes, and `count` tells afterwards.
    """

    def __init__(self, rng_key: jax.Array, num_keys: int | None) -> None:
        super().__init__(rng_seed=rng_key)
        self.count = 0
        self.keys: list[jax.Array] | None = None
        if num_keys is not None:
            self.keys = [rng_key] if num_keys <= 1 else list(jax.random.split(rng_key, num_keys))
        self.shares = num_keys is not None and num_keys > 1 and str(jax.random.key_impl(rng_key)) == "threefry2x32"

    @cached_property
    def table(self) -> jax.Array:
        """The first standard normal draws (keys, width) of each key."""
        return jax.vmap(lambda key: jax.random.normal(key, (_WIDTH,)))(jnp.stack(self.keys or []))

    def process_message(self, msg: dict[str, Any]) -> None:
        """Give a message that asks for a key the next one."""
        if msg["type"] not in ("sample", "prng_key", "plate", "control_flow"):
            return
        if msg["value"] is not None or msg["kwargs"]["rng_key"] is not None:
            return
        if self.keys is None:
            _check_has_density(msg)
        self.count += 1
        if self.keys is None:
            super().process_message(msg)
        elif self.shares and msg["type"] == "sample" and _is_small_normal(msg["fn"], msg["kwargs"]["sample_shape"]):
            shape = msg["fn"].shape()
            noise = self.table[self.count - 1, : math.prod(shape)].reshape(shape)
            msg["value"] = msg["fn"].loc + noise * msg["fn"].scale
        else:
            msg["kwargs"]["rng_key"] = self.keys[self.count - 1]


def _is_small_normal(distribution: dist.Distribution, sample_shape: tuple[int, ...]) -> bool:
    return type(distribution) is dist.Normal and not sample_shape and math.prod(distribution.shape()) <= _WIDTH


def _check_has_density(msg: Mapping[str, Any]) -> None:
    """Refuse draws that no density goes with, or the reverse."""
    if msg["type"] == "prng_key":
        raise refuse(
            "asks for numpyro.prng_key(): what it draws with a key of its own is no site, and its density would leave it "
            "out. Sample it with numpyro.sample."
        )
    if msg["type"] == "sample" and isinstance(unwrap(msg["fn"]), dist.ImproperUniform):
        raise refuse(
            f"samples {msg['name']!r} from ImproperUniform, from which nothing can be drawn. Use a proper distribution, such "
            "as a wide Normal, or Uniform between bounds."
        )


def trace_program(
    program: Program,
    arguments: tuple[Any, ...],
    *,
    seed: Seed | None = None,
    values: Mapping[str, jax.Array] | None = None,
) -> Trace:
    """Run a program and return its sites by name.

    Args:
        program: A NumPyro program.
        arguments: Its arguments.
        seed: Keys for the sites that `values` does not give. Without it a constant key serves plates, whose draws are never
            used.
        values: Values of sample sites, constrained.

    Returns:
        NumPyro's messages by site name, in order.
    """
    seed = Seed(jax.random.key(0), None) if seed is None else seed
    with (
        handlers.block(),
        handlers.trace() as sites,
        seed,
        handlers.substitute(data=dict(values or {})),
    ):
        program(*arguments)
    return dict(sites)


def sample_sites(trace: Trace) -> Trace:
    """The sample sites of a trace that are not factors."""
    return {name: site for name, site in trace.items() if site["type"] == "sample" and not is_factor(site)}


def draw(program: Program, arguments: tuple[Any, ...], rng_key: jax.Array, num_keys: int) -> dict[str, jax.Array]:
    """Values of all sample sites, drawn in the program's order; it asks for `num_keys` keys."""
    trace = trace_program(program, arguments, seed=Seed(rng_key, num_keys))
    return {name: site["value"] for name, site in sample_sites(trace).items()}


def log_density(
    program: Program,
    arguments: tuple[Any, ...],
    values: Mapping[str, jax.Array],
    mask: Mapping[str, jax.Array] | None = None,
) -> jax.Array:
    """Log-density of given site values.

    Args:
        program: A NumPyro program.
        arguments: Its arguments.
        values: The value of every sample site, of the site's exact shape.
        mask: For some sites, booleans of the value's shape; an event counts when all its entries are True. Masked
            events add exactly 0, and 0 to the gradient.

    Returns:
        The sum over sites, a scalar.
    """
    trace = trace_program(program, arguments, values=values)
    total = jnp.zeros((), jnp.result_type(float))
    for name, site in trace.items():
        if site["type"] == "sample":
            total = total + site_log_density(site, None if mask is None else mask.get(name))
    return total


def site_log_density(site: Mapping[str, Any], mask: jax.Array | None) -> jax.Array:
    """Summed log-density of one traced sample site, with its scale and an optional mask of the value's shape.

    A distribution that is a :class:`~poseppl.program.closed_forms.SummedDensity` is asked for the sum itself.
    """
    distribution = site["fn"]
    if isinstance(distribution, SummedDensity) and site.get("scale") is None:
        return distribution.summed_log_prob(site["value"], mask)
    if mask is not None and not is_factor(site):
        distribution = distribution.mask(event_mask(mask, distribution.event_dim))
    value = site["value"]
    if isinstance(base_support(distribution.support), type(constraints.circular)):
        # the state's angles are unwrapped, and NumPyro's validation calls everything beyond pi impossible
        value = (value + jnp.pi) % (2 * jnp.pi) - jnp.pi
    log_prob = distribution.log_prob(value)
    if site.get("scale") is not None:
        log_prob = site["scale"] * log_prob
    return jnp.sum(log_prob)


def event_mask(mask: jax.Array, event_dim: int) -> jax.Array:
    """Reduce a mask of value shape to batch shape: an event is observed when all of its entries are."""
    return jnp.all(mask, axis=tuple(range(mask.ndim - event_dim, mask.ndim)))
