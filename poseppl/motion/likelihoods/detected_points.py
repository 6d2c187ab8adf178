"""Image points of a body whose markers are beside their joints, by a detector whose errors last.

:class:`DetectedPoints` is, as a distribution, independent Gaussians around

    project(cameras(c), markers(tree(l), p) + s) + lasting e

of a pose p, shifts s, errors e, and, where they are not exact, errors of segment lengths l and of the cameras' poses c. The
derivative by all of them is assembled from the geometric Jacobian and a few directions in which one point moves. Reverse mode
would go through the whole body once for each number of the detector.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.cameras import Cameras, moved_cameras, project
from poseppl.motion.geometry.kinematics import frames_of, jacobian_of, marker_positions, markers_of
from poseppl.motion.geometry.tree import KinematicTree


def resized(tree: KinematicTree, per_length: KinematicTree, errors: Array) -> KinematicTree:
    """A person's tree with errors (L,) of its lengths, with each of which its offsets change so and so (leading L)."""
    return tree.with_offsets(
        tree.offsets + jnp.tensordot(errors, per_length.offsets, 1),
        tree.marker_offsets + jnp.tensordot(errors, per_length.marker_offsets, 1),
    )


def erring(cameras: Cameras, errors: Array) -> Cameras:
    """Cameras with errors (6 C,): of each a rotation vector, radians, and a shift, mm."""
    each = errors.reshape(-1, 6)
    return moved_cameras(cameras, each[:, :3], each[:, 3:])


class DetectedPoints(dist.Normal):  # type: ignore[misc]
    """Points of K markers in C cameras, with autocorrelated errors; the value has batch shape (C, K, 2).

    Args:
        tree: The body.
        cameras: C cameras.
        pose: Shape (d,).
        shift: How far markers are beside their joints (K, 3), mm.
        error: Autocorrelated errors, in units of ``lasting`` (C, K, 2).
        lasting: Their standard deviation (C, K), in the cameras' image units.
        scale: That of the noise (C, K).
        lengths: Errors of segment lengths (L,), mm, or of shape (0,).
        per_length: How the tree's offsets change with each of them (leading L); None without.
        camera_errors: Those of the cameras' poses (6 C,), radians and mm, or of shape (0,).

    Attributes:
        markers: Places of the markers (K, 3), mm.
        state: All that the location is a function of, in the order of the arguments (n,).
    """

    def __init__(
        self,
        tree: KinematicTree,
        cameras: Cameras,
        pose: Array,
        shift: Array,
        error: Array,
        *,
        lasting: Array,
        scale: Array,
        lengths: Array,
        per_length: KinematicTree | None,
        camera_errors: Array,
        validate_args: Any = None,
    ) -> None:
        self.tree, self.cameras, self.lasting, self.per_length = tree, cameras, lasting, per_length
        self._pose, self._lengths, self._camera_errors = pose, lengths, camera_errors
        self.state = jnp.concatenate([pose, *(jnp.ravel(part) for part in (shift, error, lengths, camera_errors))])
        self.markers = marker_positions(self._tree(), pose) + shift
        points = self._project(camera_errors, self.markers) + lasting[..., None] * error
        super().__init__(points, scale[..., None], validate_args=validate_args)

    def _tree(self) -> KinematicTree:
        return self.tree if self.per_length is None else resized(self.tree, self.per_length, self._lengths)

    def _project(self, camera_errors: Array, places: Array) -> Array:
        return project(erring(self.cameras, camera_errors) if camera_errors.size else self.cameras, places)

    @property
    def fixed(self) -> tuple[Any, ...]:
        """Arguments that :meth:`whitened_jacobian` takes to be constant."""
        return self.tree, self.cameras, self.lasting, self.per_length, self.scale

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """Derivative of location / scale by ``state`` (C * K * 2, n), 0 where ``mask`` is false."""
        num_cameras, num_markers, _ = self.batch_shape
        by_place = self.by_place()
        parts = [
            by_place @ self.moves(),
            jnp.einsum("ckij,kl->ckilj", by_place, jnp.eye(num_markers)),
            jnp.einsum("ck,cknm->cknm", self.lasting, jnp.eye(self.loc.size).reshape(num_cameras, num_markers, 2, -1)),
        ]
        if self.per_length is not None:
            parts.append(by_place @ self.stretches())
        if self._camera_errors.size:
            parts.append(jnp.einsum("ckij,cl->ckilj", self.by_camera(), jnp.eye(num_cameras)))
        rows = jnp.concatenate([part.reshape(*self.batch_shape, -1) for part in parts], -1) / self.scale[..., None]
        seen = rows if mask is None else jnp.where(mask[..., None], rows, 0.0)
        return seen.reshape(self.loc.size, -1)

    def moves(self) -> Array:
        """Derivatives (K, 3, d) of places by the pose."""
        derivatives: Array = _moves(self._tree(), self._pose)
        return derivatives

    def by_place(self) -> Array:
        """Derivatives (C, K, 2, 3) of points by the places of their markers."""

        def slope(axis: Array) -> Array:
            along = jnp.broadcast_to(axis, self.markers.shape)
            slopes: Array = jax.jvp(lambda places: self._project(self._camera_errors, places), (self.markers,), (along,))[1]
            return slopes

        return jax.vmap(slope, out_axes=-1)(jnp.eye(3))

    def by_camera(self) -> Array:
        """Derivatives (C, K, 2, 6) of points by the errors of their own camera."""

        def slope(axis: Array) -> Array:
            along = jnp.tile(axis, len(self.loc))
            slopes: Array = jax.jvp(lambda errors: self._project(errors, self.markers), (self._camera_errors,), (along,))[1]
            return slopes

        return jax.vmap(slope, out_axes=-1)(jnp.eye(6))

    def stretches(self) -> Array:
        """Derivatives (K, 3, L) of places by lengths: about the root, places are linear in a tree's offsets."""
        at_origin = self._pose.at[:3].set(0.0)
        return jax.vmap(lambda tree: marker_positions(tree, at_origin), out_axes=-1)(self.per_length)


def _moves_last(tree: KinematicTree, state: Array) -> Array:
    frames = frames_of(tree, state)
    return jacobian_of(tree, frames, markers_of(tree, frames))


_moves = batch_last(_moves_last)
