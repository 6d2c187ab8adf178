"""Rounding of data and their densities in float32: it has 24 bits, one part in 16 million."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.compilation import jit
from poseppl.program.count_densities import is_rounded_count
from poseppl.program.dependence import output_dependence
from poseppl.program.execution import sample_sites, unwrap
from poseppl.program.observation import Observation

_LOGGER = logging.getLogger("poseppl")
_COARSE = 0.25
"""Spacing of numbers, in standard deviations of the noise, above which rounding is reported."""
_LARGE_COUNT = 100_000
"""Counts from which rounded densities are reported."""

TraceOf = Callable[[Array, Any], Mapping[str, Any]]


class Resolution:
    """Describe how the data of a model are rounded.

    Args:
        trace_of: `(flat state (d,), inputs) -> trace of the observation program`; None where params are not known.
        dimension: d.
        inputs: Shapes of the inputs of a frame.
    """

    def __init__(self, trace_of: TraceOf | None, dimension: int, inputs: Any) -> None:
        self._trace_of, self._shapes = trace_of, (dimension, inputs)
        self._warned: set[str] = set()

    def warn(self, observation: Observation) -> None:
        """Log what is rounded, each site once."""
        for name, text in self.notes(observation).items():
            if name not in self._warned:
                self._warned.add(name)
                _LOGGER.warning(text)

    def notes(self, observation: Observation) -> dict[str, str]:
        """For each site that is rounded too much, a sentence that says so.

        That are values rounded by more than a quarter of their noise, and large counts whose density is rounded.
        """
        large = large_counts(observation)
        counts = {name: rounded_count(name, count) for name, count in large.items() if name in self._counts}
        return {**coarse_data(observation, self._noise), **counts}

    @cached_property
    def _counts(self) -> list[str]:
        return [] if self._trace_of is None else count_sites(self._trace_of, *self._shapes)

    @cached_property
    def _noise(self) -> dict[str, np.ndarray[Any, Any]]:
        return {} if self._trace_of is None else constant_noise(self._trace_of, *self._shapes)


def constant_noise(trace_of: TraceOf, dimension: int, inputs: Any) -> dict[str, np.ndarray[Any, Any]]:
    """Standard deviations, of the sites' shapes, of Gaussian data sites where they depend on neither state nor inputs.

    Args:
        trace_of: `(flat state (d,), inputs) -> trace of the observation program`.
        dimension: d.
        inputs: Shapes of the inputs of a frame.
    """
    names: list[str] = []

    def deviations(x: Array, inputs: Any) -> list[Array]:
        sites = {name: site["fn"] for name, site in sample_sites(dict(trace_of(x, inputs))).items()}
        gaussian = {name: fn for name, fn in sites.items() if isinstance(unwrap(fn), dist.Normal | dist.MultivariateNormal)}
        names[:] = gaussian
        return [jnp.broadcast_to(jnp.sqrt(fn.variance), fn.shape()) for fn in gaussian.values()]

    x, zeros = np.zeros(dimension, jnp.result_type(float)), jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), inputs)
    closed = jax.make_jaxpr(deviations)(x, zeros)
    reached = output_dependence(closed, [frozenset({0})] * len(closed.jaxpr.invars))
    fixed = [index for index, labels in enumerate(reached) if not labels]
    if not fixed:
        return {}
    values = jit(lambda x, inputs: [deviations(x, inputs)[index] for index in fixed])(x, zeros)
    if any(isinstance(value, jax.core.Tracer) for value in values):  # a model compiled inside jit: nothing is known yet
        return {}
    return {names[index]: np.asarray(value) for index, value in zip(fixed, values, strict=True)}


def count_sites(trace_of: TraceOf, dimension: int, inputs: Any) -> list[str]:
    """Names of data sites whose density is a difference of log-factorials, which large counts round; arguments as above."""
    names: list[str] = []

    def look(x: Array, inputs: Any) -> None:
        names[:] = [name for name, site in sample_sites(dict(trace_of(x, inputs))).items() if is_rounded_count(site["fn"])]

    jax.eval_shape(look, np.zeros(dimension, jnp.result_type(float)), inputs)
    return names


def coarse_data(observation: Observation, noise: Mapping[str, np.ndarray[Any, Any]]) -> dict[str, str]:
    """For each site whose data are rounded by more than a quarter of their noise, a sentence that says so."""
    found_notes = {}
    for name, deviation in noise.items():
        values = np.abs(np.asarray(observation.values[name]))
        spacing = np.where(np.asarray(observation.mask[name]), np.spacing(values), 0.0)
        if np.any(spacing > _COARSE * deviation):
            index = np.unravel_index(int(np.argmax(spacing / deviation)), values.shape)
            level = np.broadcast_to(deviation, values.shape)[index]
            or_x64 = ", or call jax.config.update('jax_enable_x64', True) first" if values.dtype == np.float32 else ""
            found_notes[name] = (
                f"observation {name!r}: numbers as large as {values[index]:.3g} are {spacing[index]:.2g} apart in "
                f"{values.dtype}, and the noise is {level:.2g}: rounding decides. Subtract a level from data and model{or_x64}"
            )
    return found_notes


def large_counts(observation: Observation) -> dict[str, int]:
    """The largest count of each integer site that reaches a hundred thousand, where densities are in float32."""
    if jnp.result_type(float) != jnp.float32:
        return {}
    integers = {name: values for name, values in observation.values.items() if values.dtype.kind in "iu"}
    largest = {name: int(np.max(np.where(observation.mask[name], values, 0), initial=0)) for name, values in integers.items()}
    return {name: count for name, count in largest.items() if count >= _LARGE_COUNT}


def rounded_count(name: str, count: int) -> str:
    """The sentence for a site of large counts whose density is rounded."""
    return (
        f"observation {name!r}: float32 rounds the density of a count as large as {count}, by up to about "
        f"{count * math.log(count) * 6e-8:.1g} nats. Call jax.config.update('jax_enable_x64', True) first, or use a Poisson, "
        "binomial or negative binomial distribution, whose densities are exact"
    )
