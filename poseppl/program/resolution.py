"""Whether data are told apart as finely as their noise asks: float32 has 24 bits, one part in 16 million."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.compilation import jit
from poseppl.program.dependence import output_dependence
from poseppl.program.execution import sample_sites, unwrap
from poseppl.program.observation import Observation

_LOGGER = logging.getLogger("poseppl")
_COARSE = 0.25
"""Spacing of numbers, in standard deviations of the noise, above which rounding is told."""

TraceOf = Callable[[Array, Any], Mapping[str, Any]]


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


def tell_rounding(observation: Observation, noise: dict[str, np.ndarray[Any, Any]]) -> None:
    """Warn of data that are rounded by more than a quarter of their noise; each site is told once, and leaves `noise`."""
    for name in list(noise):
        values = np.abs(np.asarray(observation.values[name]))
        spacing = np.where(np.asarray(observation.mask[name]), np.spacing(values), 0.0)
        coarse = spacing > _COARSE * noise[name]
        if np.any(coarse):
            index = np.unravel_index(int(np.argmax(spacing / noise[name])), values.shape)
            _LOGGER.warning(
                "observation %r: numbers as large as %.3g are %.2g apart in %s, and the noise is %.2g: rounding decides. "
                "Subtract a level from data and model, or call jax.config.update('jax_enable_x64', True) first",
                *(name, values[index], spacing[index], values.dtype),
                np.broadcast_to(noise.pop(name), values.shape)[index],
            )
