"""The image cost of :mod:`poseppl_models.sminchisescu_triggs.cost` as a distribution with gradient and curvature.

A residual moves with its own part alone, with the occlusion by other parts fixed, and a part as its link does: six derivatives,
by shifts and turns of all parts at once, give all d columns of the Jacobian (:func:`derivatives_of_wrenches`).
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.batch_last import batch_last, batched_density, batched_score
from poseppl.motion.geometry.kinematics import derivatives_of_wrenches, frames_of
from poseppl_models.sminchisescu_triggs.cost import CostNoise, CostSettings, ImageSeen, residuals_of
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics, part_axes

_CHUNK = 16


def _residuals_last(state: Array, tree: KinematicTree, flesh: Superquadrics, *seen: Any, settings: CostSettings) -> Array:
    """Residuals (C, entries, N) of states (d, N), given cameras, what they saw, and its noise."""
    found = residuals_of(settings, (tree, flesh, *seen), part_axes(flesh, frames_of(tree, state)))
    return found.reshape(len(found), -1, found.shape[-1])


def _jacobian_last(
    state: Array, tree: KinematicTree, flesh: Superquadrics, *seen: Any, settings: CostSettings, curved: bool = False
) -> Array:
    """Derivatives (C, entries, d, N): a residual moves with its own part, as that part's link does."""
    frames = frames_of(tree, state)
    axes, centres = part_axes(flesh, frames)
    count = state.shape[-1]

    def residuals(axes: Array, centres: Array) -> Array:
        others = jax.lax.stop_gradient((axes, centres))
        found = residuals_of(settings, (tree, flesh, *seen), (axes, centres), others, curved=curved)
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


class _Functions(NamedTuple):
    """The batch-last functions of some settings, as functions of single states."""

    residuals: Any
    density: Any
    jacobian: Any
    curvature: Any


@lru_cache(maxsize=8)
def _functions(settings: CostSettings) -> _Functions:
    residuals = partial(_residuals_last, settings=settings)

    def density(state: Array, *constants: Any) -> Array:
        *known, value, mask = constants
        offset = residuals(state, *known) - value
        terms = -0.5 * offset**2 - 0.5 * np.log(2 * np.pi)
        return jnp.sum(jnp.where(mask > 0, terms, 0.0), (0, 1))

    return _Functions(
        batched_score(residuals, chunk=_CHUNK),
        batched_density(density, chunk=_CHUNK),
        *(batch_last(partial(_jacobian_last, settings=settings, curved=each), chunk=_CHUNK) for each in (False, True)),
    )


class ImageResiduals(dist.Normal):  # type: ignore[misc]
    """Residuals (C, entries) of a state in images; the value is 0. Only differentiated by the state.

    Args:
        residuals: Function of a state and the data of its images.
        jacobian: Their derivatives (C, entries, d).
        curvature: Rows (C, entries, d) whose squares add up to the curvature of the cost.
        state: Shape (d,).
        known: Data of the images.
    """

    is_predictive = False
    """The images are among the arguments: a draw is of no image."""

    def __init__(
        self,
        residuals: Any,
        jacobian: Any,
        curvature: Any,
        state: Array,
        known: tuple[Any, ...],
        *,
        validate_args: Any = None,
    ) -> None:
        self.jacobian, self.curvature, self.state, self.known = jacobian, curvature, state, known
        super().__init__(residuals(state, *known), 1.0, validate_args=validate_args)

    @property
    def fixed(self) -> tuple[Any, ...]:
        """Arguments that :meth:`whitened_jacobian` takes to be constant."""
        return self.known

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """Derivative of the residuals by ``state`` (C * entries, d), 0 where masked."""
        return self._rows(self.jacobian, mask)

    def curvature_rows(self, mask: Array | None) -> Array:
        """Rows (C * entries, d) whose squares add up to the curvature of the cost, 0 where masked."""
        return self._rows(self.curvature, mask)

    def _rows(self, function: Any, mask: Array | None) -> Array:
        rows: Array = function(self.state, *self.known)
        seen = jnp.ones(self.batch_shape, bool) if mask is None else mask
        return jnp.where(seen[..., None], rows, 0.0).reshape(-1, self.state.shape[0])


class ContourAndFlow(ImageResiduals):
    """The residuals of a pose, of batch shape (C, P * entries a part); derivatives keep occlusion by other parts fixed.

    Args:
        tree: The body.
        flesh: Its parts.
        cameras: C cameras, px.
        state: Shape (d,).
        seen: The data.
        noise: Standard deviations and weights.
        settings: The cost's numbers.
    """

    def __init__(
        self,
        tree: KinematicTree,
        flesh: Superquadrics,
        cameras: Cameras,
        state: Array,
        seen: ImageSeen,
        noise: CostNoise,
        settings: CostSettings,
        *,
        validate_args: Any = None,
    ) -> None:
        self.settings, own = settings, _functions(settings)
        known = (tree, flesh, cameras, seen, noise)
        super().__init__(own.residuals, own.jacobian, own.curvature, state, known, validate_args=validate_args)

    def summed_log_prob(self, value: Array, mask: Array | None) -> Array:
        """Log-density of the entries of ``value`` where ``mask`` is true, in one pass."""
        weight = jnp.ones(value.shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        density: Array = _functions(self.settings).density(self.state, *self.known, value, weight)
        return density
