"""Run one NumPyro program as a pure function: draw its sites, or sum their log-densities.

Every run is isolated from the handlers that surround the call (`handlers.block`). So a filter inside another NumPyro program
does not leak its sites into that program, and does not inherit its scales, masks and seeds. Tracing costs nothing under
`jax.jit`; outside it a run takes tens of milliseconds.

For a program with sample sites s, distributions p_s, scales w_s (`handlers.scale`) and masks m_s,

    log p = sum over s of sum(w_s * m_s * log p_s(value_s)),

where a `numpyro.factor` site counts its factor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array
from numpyro import handlers
from numpyro.distributions import constraints
from numpyro.distributions.distribution import Unit

from poseppl.program.closed_forms import SummedDensity
from poseppl.program.count_densities import stable
from poseppl.program.explanation import refuse
from poseppl.program.partly_seen import can_be_partly_seen, is_partly_seen, partly_seen_log_densities

Program = Callable[..., Any]
Trace = dict[str, dict[str, Any]]
Values = Mapping[str, Array] | Callable[[Mapping[str, Any]], Array | None]
"""Values of sample sites, constrained: by name, or from NumPyro's message about any site, None for those not given."""


def unwrap(distribution: dist.Distribution) -> dist.Distribution:
    """The distribution inside Independent, Masked and Expanded wrappers."""
    while isinstance(distribution, dist.Independent | dist.MaskedDistribution | dist.ExpandedDistribution):
        distribution = distribution.base_dist
    return distribution


def is_masked(distribution: dist.Distribution) -> bool:
    """Whether there is a mask among its Independent, Masked and Expanded wrappers."""
    while isinstance(distribution, dist.Independent | dist.ExpandedDistribution):
        distribution = distribution.base_dist
    return isinstance(distribution, dist.MaskedDistribution)


def base_support(support: Any) -> Any:
    """The elementwise constraint inside `independent` wrappers."""
    while isinstance(support, type(constraints.independent(constraints.unit_interval, 1))):
        support = support.base_constraint
    return support


def is_factor(site: Mapping[str, Any]) -> bool:
    """Whether a traced site comes from `numpyro.factor`."""
    return site["type"] == "sample" and isinstance(unwrap(site["fn"]), Unit)


class RngBudget(NamedTuple):
    """The random numbers that a draw from a program uses.

    Attributes:
        num_keys: PRNG keys of its own, for sites that are not Normal.
        num_normals: Standard normal numbers, entries of its Normal sites.
    """

    num_keys: int = 0
    num_normals: int = 0


class Seed(handlers.seed):  # type: ignore[misc]
    """Give the sites of a program their randomness; NumPyro's own seed splits keys for each of them.

    Random bits are what a particle filter spends most of its time on, and what a program of many sites takes longest to
    compile. So all Normal sites share one array of standard normal numbers, and the other sites the keys of one split; a key
    that serves one purpose alone is not split.

    Args:
        rng_key: The key.
        randomness: The numbers that the program needs; None splits keys on demand, and `counted` returns the number afterwards.
    """

    def __init__(self, rng_key: Array, randomness: RngBudget | None) -> None:
        super().__init__(rng_seed=rng_key)
        self.counted, self.counts = RngBudget(), randomness is None
        self.randomness = randomness or RngBudget()
        number = self.randomness.num_keys + (self.randomness.num_normals > 0)
        self.noise: dict[str, Array] = {}
        self.keys = [rng_key] if number <= 1 else list(jax.random.split(rng_key, number))

    @cached_property
    def normals(self) -> Array:
        """The standard normal numbers of all Normal sites, one after the other."""
        return jax.random.normal(self.keys[-1], (self.randomness.num_normals,))

    def process_message(self, msg: dict[str, Any]) -> None:
        """Give a message that asks for a key the next one, or its value."""
        if msg["type"] not in ("sample", "prng_key", "plate", "control_flow"):
            return
        if msg["value"] is not None or msg["kwargs"]["rng_key"] is not None:
            return
        if self.counts:
            _check_has_density(msg)
        before = self.counted
        shape = _normal_shape(msg)
        if shape is None:
            self.counted = before._replace(num_keys=before.num_keys + 1)
        else:
            self.counted = before._replace(num_normals=before.num_normals + math.prod(shape))
        if self.counts:
            super().process_message(msg)
        elif shape is None:
            key = self.keys[before.num_keys]
            msg["kwargs"]["rng_key"] = key if _is_drawn_at_once(msg) else _threefry(key)
        else:
            base = unwrap(msg["fn"])
            noise = self.normals[before.num_normals : self.counted.num_normals].reshape(shape)
            msg["value"] = base.loc + noise * base.scale
            self.noise[msg["name"]] = noise


def _normal_shape(msg: Mapping[str, Any]) -> tuple[int, ...] | None:
    """Shape of the draw of a Normal site, None of any other message."""
    if msg["type"] != "sample" or type(unwrap(msg["fn"])) is not dist.Normal:
        return None
    return (*msg["kwargs"]["sample_shape"], *msg["fn"].shape())


def _threefry(rng_key: Array) -> Array:
    """The key, or where it is another generator's (particles share one) a key of JAX's default one drawn from it."""
    if jax.random.key_impl(rng_key) == "threefry2x32":
        return rng_key
    key: Array = jax.random.wrap_key_data(jax.random.bits(rng_key, (2,), jnp.uint32), impl="threefry2x32")
    return key


_DRAWN_AT_ONCE = (
    *(dist.BernoulliLogits, dist.BernoulliProbs, dist.CategoricalLogits, dist.CategoricalProbs, dist.Cauchy, dist.Delta),
    *(dist.DiscreteUniform, dist.Exponential, dist.Gumbel, dist.HalfCauchy, dist.HalfNormal, dist.Laplace, dist.Logistic),
    *(dist.LogNormal, dist.LowRankMultivariateNormal, dist.MultivariateNormal, dist.Normal, dist.Uniform),
    *(type(dist.TruncatedNormal(low=0.0)), type(dist.TruncatedNormal(high=0.0)), type(dist.TruncatedNormal(low=0.0, high=1.0))),
)
"""Distributions that are drawn from random bits of a number that is known before."""


def _is_drawn_at_once(msg: Mapping[str, Any]) -> bool:
    """Whether a message is a site that is drawn without a loop of random length.

    Under `jax.vmap` such a loop, as of rejection samplers, goes on with the keys of the particles that are not done. Particles
    that share a generator all draw from the key of the first, which stands still when the first is done.
    """
    return msg["type"] == "sample" and type(unwrap(msg["fn"])) in _DRAWN_AT_ONCE


def has_derivative(distribution: dist.Distribution) -> bool:
    """Whether a draw is a differentiable function of the distribution's parameters: no integer, no choice, no rejection."""
    base = unwrap(distribution)
    chooses = isinstance(base, dist.MixtureGeneral | dist.MixtureSameFamily)
    return bool(not base.is_discrete and base.has_rsample and not chooses)


@jax.custom_jvp
def derivative_only(value: Array) -> Array:
    """0, with the derivative of the value, which is computed where that is asked for alone."""
    never = jnp.zeros_like(value, bool)
    return jnp.where(never, value, 0.0)  # has the batch of the value, as a constant would not, and XLA leaves the value out


@derivative_only.defjvp
def _derivative_of(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    return derivative_only(primals[0]), tangents[0]


def _check_has_density(msg: Mapping[str, Any]) -> None:
    """Refuse draws that no density goes with, or the reverse."""
    if msg["type"] == "prng_key":
        raise refuse(
            "asks for numpyro.prng_key(): what it draws with a key of its own is no site, and its density would leave it "
            "out. Sample it with numpyro.sample."
        )
    if msg["type"] == "plate":
        raise refuse(
            f"draws a subsample in the plate {msg['name']!r}, and the data would be those of other indices in each frame. "
            "Leave subsample_size out, with NaN for what was not seen."
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
    values: Values | None = None,
) -> Trace:
    """Run a program and return its sites by name.

    Args:
        program: A NumPyro program.
        arguments: Its arguments.
        seed: RngBudget of the sites that `values` does not give. Without it a constant key serves them.
        values: Values of sample sites.

    Returns:
        NumPyro's messages by site name, in order.
    """
    seed = Seed(jax.random.key(0), None) if seed is None else seed
    with (
        handlers.block(),
        handlers.trace() as sites,
        seed,
        handlers.substitute(substitute_fn=values) if callable(values) else handlers.substitute(data=dict(values or {})),
    ):
        program(*arguments)
    return dict(sites)


def sample_sites(trace: Trace) -> Trace:
    """The sample sites of a trace that are not factors."""
    return {name: site for name, site in trace.items() if site["type"] == "sample" and not is_factor(site)}


def draw(program: Program, arguments: tuple[Any, ...], rng_key: Array, randomness: RngBudget) -> dict[str, Array]:
    """Values of all sample sites, drawn in the program's order."""
    trace = trace_program(program, arguments, seed=Seed(rng_key, randomness))
    return {name: site["value"] for name, site in sample_sites(trace).items()}


def log_density(
    program: Program,
    arguments: tuple[Any, ...],
    values: Mapping[str, Array],
    mask: Mapping[str, Array] | None = None,
) -> Array:
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
    return trace_log_density(trace_program(program, arguments, values=values), mask)


def trace_log_density(trace: Trace, mask: Mapping[str, Array] | None = None) -> Array:
    """Log-density of the values in a trace; see :func:`log_density`."""
    total = jnp.zeros((), jnp.result_type(float))
    for name, site in trace.items():
        if site["type"] == "sample":
            total = total + site_log_density(site, None if mask is None else mask.get(name))
    return total


def site_log_density(site: Mapping[str, Any], mask: Array | None) -> Array:
    """Summed log-density of one traced sample site, with its scale and an optional mask of the value's shape.

    A distribution that is a :class:`~poseppl.program.closed_forms.SummedDensity` is asked for the sum itself.
    """
    distribution = site["fn"]
    if isinstance(distribution, SummedDensity) and site.get("scale") is None:
        return distribution.summed_log_prob(site["value"], mask)
    if mask is not None and not is_factor(site):
        return jnp.sum(masked_event_log_densities(site, mask))
    return jnp.sum(event_log_densities(site))


def masked_event_log_densities(site: Mapping[str, Any], mask: Array) -> Array:
    """Log-densities of the events of a site, 0 where they were not seen; of what was seen of them, where that is known."""
    distribution = site["fn"]
    whole = event_log_densities({**site, "fn": distribution.mask(event_mask(mask, distribution.event_dim))})
    base = unwrap(distribution)
    if not can_be_partly_seen(base) or is_masked(distribution) or site.get("scale") is not None:
        return whole

    def partly() -> Array:
        densities = partly_seen_log_densities(base, site["value"], mask)
        return jnp.sum(densities.reshape(*whole.shape, -1), -1).astype(whole.dtype)

    found: Array = jax.lax.cond(is_partly_seen(mask), partly, lambda: whole)
    return found


def event_log_densities(site: Mapping[str, Any]) -> Array:
    """Log-densities of the events of one traced sample site, in its batch shape, with its scale."""
    distribution, value = site["fn"], site["value"]
    if isinstance(base_support(distribution.support), type(constraints.circular)):
        # the state's angles are unwrapped, and NumPyro's validation calls everything beyond pi impossible
        value = (value + jnp.pi) % (2 * jnp.pi) - jnp.pi
    log_prob: Array = stable(distribution).log_prob(value)
    if isinstance(unwrap(distribution), dist.DiscreteUniform):
        # its density is the same everywhere, and its bounds may move from frame to frame
        log_prob = jnp.where(distribution.support(value), log_prob, -jnp.inf)
    return log_prob if site.get("scale") is None else site["scale"] * log_prob


def any_event_mask(mask: Array, distribution: dist.Distribution) -> Array:
    """Which events were seen, in batch shape: all entries, or any of a distribution that can be seen in part."""
    axes = tuple(range(mask.ndim - distribution.event_dim, mask.ndim))
    return jnp.any(mask, axes) if can_be_partly_seen(unwrap(distribution)) else jnp.all(mask, axes)


def event_mask(mask: Array, event_dim: int) -> Array:
    """Reduce a mask of value shape to batch shape: an event is observed when all of its entries are."""
    return jnp.all(mask, axis=tuple(range(mask.ndim - event_dim, mask.ndim)))
