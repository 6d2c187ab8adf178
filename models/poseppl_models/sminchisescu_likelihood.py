"""The image cost of :mod:`poseppl_models.sminchisescu_cost` as a distribution with gradient and Gauss-Newton curvature.

A residual moves with its own part alone, what other parts hide held fixed, and a part as its link does: six derivatives, by
shifts and turns of all parts at once, give all d columns of the Jacobian (:func:`derivatives_of_wrenches`).
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.batched_score import batched_score
from poseppl.motion.geometry.kinematics import derivatives_of_wrenches, frames_of
from poseppl.motion.geometry.superquadrics import Superquadrics, part_axes
from poseppl_models.sminchisescu_cost import CostNoise, ImageSeen, residuals_of

_CHUNK = 16


def _residuals_last(state: Array, tree: KinematicTree, flesh: Superquadrics, *seen: Any) -> Array:
    """Residuals (C, entries, N) of states (d, N), given cameras, what they saw, and its noise."""
    found = residuals_of((tree, flesh, *seen), part_axes(flesh, frames_of(tree, state)))
    return found.reshape(len(found), -1, found.shape[-1])


def _jacobian_last(state: Array, tree: KinematicTree, flesh: Superquadrics, *seen: Any) -> Array:
    """Derivatives (C, entries, d, N): a residual moves with its own part, as that part's link does."""
    frames = frames_of(tree, state)
    axes, centres = part_axes(flesh, frames)
    count = state.shape[-1]

    def residuals(axes: Array, centres: Array) -> Array:
        others = jax.lax.stop_gradient((axes, centres))
        found = residuals_of((tree, flesh, *seen), (axes, centres), others)
        return jnp.broadcast_to(found, (*found.shape[:-1], count))

    unit = jnp.eye(3, dtype=state.dtype)
    shifts = [(jnp.zeros_like(axes), jnp.broadcast_to(row[:, None], centres.shape)) for row in unit]
    turns = [(_cross(row[:, None, None], axes), _cross(row[:, None], centres)) for row in unit]
    tangents = jax.tree.map(lambda *rows: jnp.stack(rows), *shifts, *turns)
    slopes = jax.vmap(lambda way: jax.jvp(residuals, (axes, centres), way)[1])(tangents)  # (6, C, P, entries, N)
    force, moment = (jnp.moveaxis(part, 0, 3) for part in (slopes[:3], slopes[3:]))
    link = jnp.broadcast_to(jnp.asarray(flesh.links)[:, None, None], force.shape[1:3] + force.shape[-1:])
    moved = derivatives_of_wrenches(tree, frames, force, moment, jnp.broadcast_to(link, (len(force), *link.shape)))
    return moved.reshape(len(moved), -1, *moved.shape[3:])


def _cross(row: Array, vectors: Array) -> Array:
    """Cross product of one vector with vectors (P, 3, ...)."""
    return jnp.cross(jnp.broadcast_to(row, vectors.shape), vectors, axis=1)


def _density_last(state: Array, fixed: Any) -> Array:
    """Log-densities (N,) of states (d, N), given what is known of the images, values and mask."""
    *known, value, mask = fixed
    offset = _residuals_last(state, *known) - value
    terms = -0.5 * offset**2 - 0.5 * np.log(2 * np.pi)
    return jnp.sum(jnp.where(mask > 0, terms, 0.0), (0, 1))


def _value_and_gradient_last(state: Array, fixed: Any) -> tuple[Array, Array]:
    value, pull = jax.vjp(partial(_density_last, fixed=fixed), state)
    return value, pull(jnp.ones_like(value))[0]


_residuals = batched_score(_residuals_last, chunk=_CHUNK)
_density = batch_last(_density_last, chunk=_CHUNK)
_value_and_gradient = batch_last(_value_and_gradient_last, chunk=_CHUNK)
_jacobian = batch_last(_jacobian_last, chunk=_CHUNK)


@jax.custom_vjp
def _log_density(state: Array, fixed: Any) -> Array:
    density: Array = _density(state, fixed)
    return density


def _forward(state: Array, fixed: Any) -> tuple[Array, Any]:
    density, gradient = _value_and_gradient(state, fixed)
    return density, (gradient, fixed)


def _backward(kept: Any, cotangent: Array) -> Any:
    gradient, fixed = kept
    return gradient * cotangent, jax.tree.map(jnp.zeros_like, fixed)


_log_density.defvjp(_forward, _backward)


class ContourAndFlow(dist.Normal):  # type: ignore[misc]
    """The residuals of a pose, of batch shape (C, P * entries a part); the value is 0. Only differentiated by the state.

    Derivatives hold fixed what other parts hide.

    Args:
        tree: The body.
        flesh: Its parts.
        cameras: C cameras, px.
        state: Shape (d,).
        seen: What was seen.
        noise: Standard deviations and weights.
    """

    is_predictive = False
    """The images are among the arguments: a draw is of no image."""

    def __init__(
        self,
        tree: KinematicTree,
        flesh: Superquadrics,
        cameras: Cameras,
        state: Array,
        seen: ImageSeen,
        noise: CostNoise,
        *,
        validate_args: Any = None,
    ) -> None:
        self.state, self.known = state, (tree, flesh, cameras, seen, noise)
        super().__init__(_residuals(state, *self.known), 1.0, validate_args=validate_args)

    @property
    def fixed(self) -> tuple[Any, ...]:
        """Arguments that :meth:`whitened_jacobian` takes to be constant."""
        return self.known

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """Derivative of the residuals by ``state`` (C * entries, d), 0 where masked."""
        rows: Array = _jacobian(self.state, *self.known)
        seen = jnp.ones(self.batch_shape, bool) if mask is None else mask
        return jnp.where(seen[..., None], rows, 0.0).reshape(-1, self.state.shape[0])

    def summed_log_prob(self, value: Array, mask: Array | None) -> Array:
        """Log-density of the entries of ``value`` where ``mask`` is true, in one pass."""
        weight = jnp.ones(value.shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        return _log_density(self.state, (*self.known, value, weight))
