"""Image points of a body, evaluated in one pass.

:class:`ProjectedMarkers` is, as a distribution, independent Gaussians around the projected markers of a pose (Eqs. 18 and 20 of
Choo and Fleet 2001). Written with ``dist.Normal`` on the projected points it would be the same, but every particle's points
would pass through memory; here the likelihood alone is one loop over the particles, and its gradient goes through the
geometric Jacobian.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.cameras import Cameras, project, project_components
from poseppl.motion.geometry.kinematics import (
    frames_of,
    jacobian_of,
    marker_positions,
    markers_of,
    pull_back,
    unrolled_forward_kinematics,
)
from poseppl.motion.geometry.tree import KinematicTree

_FUSE_FROM = 4096
"""Batch size from which a likelihood without gradient is one fused loop. The loop is ten times as fast on large batches, but
takes seconds to compile, which small batches do not recover."""


class ProjectedMarkers(dist.Normal):  # type: ignore[misc]
    """Markers of a body seen by cameras, with independent Gaussian noise; the value has batch shape (C, markers, 2).

    Args:
        tree: The body.
        cameras: C cameras.
        state: Shape (d,).
        scale: Standard deviation of the noise, in the cameras' image units: a scalar, or (C, markers) where it differs (say
            by a detector's confidence).
    """

    def __init__(self, tree: KinematicTree, cameras: Cameras, state: Array, scale: Any, *, validate_args: Any = None):
        self.tree, self.cameras, self.state = tree, cameras, state
        points = project(cameras, marker_positions(tree, state))
        self.marker_scale = jnp.broadcast_to(jnp.asarray(scale, state.dtype), points.shape[:-1])
        super().__init__(points, self.marker_scale[..., None], validate_args=validate_args)

    def summed_log_prob(self, value: Array, mask: Array | None) -> Array:
        """Log-density of the entries of ``value`` where ``mask`` (of its shape) is true, summed in one pass."""
        seen = jnp.ones(value.shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        return projected_log_density(self.tree, self.state, self.cameras, self.marker_scale, value, seen)

    @property
    def fixed(self) -> tuple[KinematicTree, Cameras]:
        """Arguments that :meth:`whitened_jacobian` takes to be constant."""
        return self.tree, self.cameras

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """Derivative of location / scale by ``state``, (C * markers * 2, d), zero where ``mask`` is false; in closed form."""
        seen = jnp.ones((*self.marker_scale.shape, 2), bool) if mask is None else mask
        rows: Array = _whitened_jacobian(self.tree, self.state, self.cameras, self.marker_scale, seen)
        return rows.reshape(-1, self.tree.dimension)


def _whitened_jacobian_last(tree: KinematicTree, state: Array, cameras: Cameras, scale: Any, mask: Any) -> Array:
    """Whitened Jacobians (C, markers, 2, d, N) of a batch."""
    frames = frames_of(tree, state)
    positions = markers_of(tree, frames)
    moves = jacobian_of(tree, frames, positions)
    spread = _spread(cameras)
    place = tuple(jnp.broadcast_to(positions[None, :, i], (*scale.shape[:2], state.shape[-1])) for i in range(3))
    unit = jnp.ones_like(place[0])
    rows = []
    for axis in range(3):
        tangent = tuple(unit if i == axis else 0 * unit for i in range(3))
        slopes = jax.jvp(lambda x, y, z: project_components(spread, x, y, z), place, tangent)[1]
        rows.append(jnp.stack(slopes, 2))  # (C, markers, 2, N)
    by_x, by_y, by_z = (jnp.where(mask, row / scale[:, :, None], 0.0)[:, :, :, None] for row in rows)
    moves = moves[None, :, None]
    return by_x * moves[:, :, :, 0] + by_y * moves[:, :, :, 1] + by_z * moves[:, :, :, 2]


_whitened_jacobian = batch_last(_whitened_jacobian_last)


def _tail(cameras: Cameras, scale: Any, value: Any, mask: Any, x: Any, y: Any, z: Any) -> Any:
    """Log-density of markers at world coordinates x, y, z, component by component."""
    u, v = project_components(cameras, x, y, z)
    inverse = 1.0 / scale
    constant = -jnp.log(scale) - 0.5 * np.log(2 * np.pi)
    first, second = mask[0] > 0, mask[1] > 0
    # chosen twice, not multiplied by the mask: the first keeps gradients finite, the second values, whatever stands there
    a, b = jnp.where(first, u - value[0], 0.0) * inverse, jnp.where(second, v - value[1], 0.0) * inverse
    return jnp.where(first, constant - 0.5 * a * a, 0.0) + jnp.where(second, constant - 0.5 * b * b, 0.0)


def _value_last(tree: KinematicTree, state: Array, cameras: Cameras, scale: Any, value: Any, mask: Any) -> Array:
    """Log-density of a batch (d, N): (N,)."""
    if state.shape[-1] < _FUSE_FROM:
        return _summed(markers_of(tree, frames_of(tree, state)), cameras, scale, value, mask)
    total = jnp.zeros(state.shape[-1], state.dtype)
    markers = unrolled_forward_kinematics(tree, list(state))
    for camera in range(cameras.centre.shape[0]):
        lens = jax.tree.map(lambda leaf, camera=camera: leaf[camera], cameras)
        for marker, position in enumerate(markers):
            total += _tail(lens, scale[camera, marker], value[camera, marker], mask[camera, marker], *position)
    return total


def _summed(positions: Array, cameras: Cameras, scale: Array, value: Array, mask: Array) -> Array:
    """Log-density of markers at ``positions`` (markers, 3, N): (N,)."""
    components = (positions[None, :, i] for i in range(3))
    return jnp.sum(_tail(_spread(cameras), scale, jnp.moveaxis(value, 2, 0), jnp.moveaxis(mask, 2, 0), *components), (0, 1))


def _spread(cameras: Cameras) -> Cameras:
    """Bring cameras (C, ..., N) to the shape (..., C, 1, N) of many markers."""
    spread: Cameras = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2)[..., None, :], cameras)
    return spread


def _value_and_gradients_last(
    tree: KinematicTree, state: Array, cameras: Cameras, scale: Any, value: Any, mask: Any
) -> tuple[Array, Any]:
    """Log-density of a batch and its gradients with respect to tree, state, cameras, scale and value."""
    frames = frames_of(tree, state)
    positions = markers_of(tree, frames)
    count = state.shape[-1]
    shared = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (*leaf.shape[:-1], count)), (cameras, scale, value))
    density, pull = jax.vjp(lambda p, c, s, v: _summed(p, c, s, v, mask), positions, *shared)
    forces, *others = pull(jnp.ones_like(density))
    return density, (*pull_back(tree, frames, positions, forces), *others)


_value = batch_last(_value_last)
_value_and_gradients = batch_last(_value_and_gradients_last)


@jax.custom_vjp
def projected_log_density(
    tree: KinematicTree, state: Array, cameras: Cameras, scale: Array, value: Array, mask: Array
) -> Array:
    """Gaussian log-density of image points (Eq. 20).

    Args:
        tree: The body.
        state: Shape (d,).
        cameras: C cameras.
        scale: Shape (C, markers).
        value: Image points (C, markers, 2).
        mask: 1 where observed, else 0; same shape.

    Returns:
        A scalar. Its derivative by the mask is zero by definition.
    """
    density: Array = _value(tree, state, cameras, scale, value, mask)
    return density


def _forward(*args: Any) -> tuple[Array, Any]:
    density, gradients = _value_and_gradients(*args)
    return density, (gradients, args[-1])


def _backward(residuals: Any, cotangent: Array) -> Any:
    gradients, mask = residuals
    return (*jax.tree.map(lambda leaf: leaf * cotangent, gradients), jnp.zeros_like(mask))


projected_log_density.defvjp(_forward, _backward)
