"""A silhouette seen by cameras, as Gaussian residuals: a likelihood that gradient methods and Kalman filters can use.

Two kinds of residuals say that the silhouette of the body and that in the image are the same, both signed distances in pixels
whose value is observed to be 0:

* from each of K points on the observed contour to the nearest part of the body in the image, negative inside
  (:mod:`poseppl.geometry.coverage`): the body's outline passes through the contour;
* from points along the axis of each part to the observed silhouette, as far as the part sticks out of it,

      max(0, D(u) + r / 2),

  D being the signed distance to the observed silhouette at the axis point u, and r the part's half-width there.

Each is bent by c tanh(. / c), so that a gross error of segmentation counts as much as c pixels and no more. Neighbours on a
contour err alike; their standard deviation has to be raised by the root of how many do.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpyro.distributions as dist

from poseppl.geometry.barrier import computed_once
from poseppl.geometry.batch_last import batch_last
from poseppl.geometry.batched_score import batched_score
from poseppl.geometry.cameras import Cameras, project_components
from poseppl.geometry.coverage import part_distances, project_parts
from poseppl.geometry.flesh import Flesh, PartFrames, parts_of, place_parts
from poseppl.geometry.kinematics import derivatives_of_pushes, frames_of
from poseppl.geometry.tree import KinematicTree

FRACTIONS = (0.0, 0.35, 0.7, 1.0)
"""Where along each part's axis it is asked whether the part sticks out."""
_CHUNK = 32
_GROSS = 20.0
"""Pixels beyond which a residual counts no more."""
_DEPTH = 0.5
"""Share of a part's half-width by which its axis has to lie inside of the silhouette."""
_SOFT = 1.0
"""Pixels over which a part begins to stick out."""


class SilhouetteSeen(NamedTuple):
    """What was seen in a frame.

    Attributes:
        contour: Points of the contour (C, K, 2), px.
        distance: Signed distance to the silhouette (C, H, W), in px of the image, negative inside.
        scale: Pixels of ``distance`` to one of the image (C,): centres of pixels are at whole numbers in both.
    """

    contour: jax.Array
    distance: jax.Array
    scale: jax.Array


class Silhouettes(dist.Normal):  # type: ignore[misc]
    """Distances between a body's silhouette and the observed one; the value has batch shape (C, K + parts * 4) and is 0.

    Args:
        tree: The body.
        flesh: Its parts.
        cameras: C cameras.
        state: Shape (d,).
        seen: What was seen.
        noise: Standard deviation of the distances (C,), px.
    """

    def __init__(
        self,
        tree: KinematicTree,
        flesh: Flesh,
        cameras: Cameras,
        state: jax.Array,
        seen: SilhouetteSeen,
        noise: jax.Array,
        *,
        validate_args: Any = None,
    ):
        self.tree, self.flesh, self.cameras, self.state, self.seen = tree, flesh, cameras, state, seen
        self.noise = jnp.asarray(noise, state.dtype)
        distances = silhouette_distances(tree, flesh, cameras, state, seen)
        super().__init__(distances, jnp.broadcast_to(self.noise[:, None], distances.shape), validate_args=validate_args)

    def summed_log_prob(self, value: jax.Array, mask: jax.Array | None) -> jax.Array:
        """Log-density of the entries of ``value`` where ``mask`` is true, in one pass; only differentiated by the state."""
        weight = jnp.ones(value.shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        fixed = (self.tree, self.flesh, self.cameras, self.seen, self.noise, value, weight)
        return _log_density(self.state, fixed)

    @property
    def fixed(self) -> tuple[Any, ...]:
        """What :meth:`whitened_jacobian` takes to be constant."""
        return self.tree, self.flesh, self.cameras, self.seen

    def whitened_jacobian(self, mask: jax.Array | None) -> jax.Array:
        """Derivative of location / scale by ``state``, (C * entries, d), zero where ``mask`` is false; in closed form."""
        weight = jnp.ones(self.batch_shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        rows: jax.Array = _jacobian(self.state, self.tree, self.flesh, self.cameras, self.seen)
        return (rows * (weight / self.noise[:, None])[..., None]).reshape(-1, self.state.shape[0])


def silhouette_distances(
    tree: KinematicTree, flesh: Flesh, cameras: Cameras, state: jax.Array, seen: SilhouetteSeen
) -> jax.Array:
    """All residuals (C, K + parts * 4) of one state (d,), px; only differentiated by the state, in reverse."""
    distances: jax.Array = _distances(state, tree, flesh, cameras, seen)
    return distances


def _distances_last(state: jax.Array, tree: KinematicTree, flesh: Flesh, cameras: Cameras, seen: SilhouetteSeen) -> jax.Array:
    """Residuals (C, entries, N) of states (d, N)."""
    parts = parts_of(tree, flesh, state)
    shapes = computed_once(project_parts(cameras, flesh, parts))
    outline = jnp.min(part_distances(shapes, seen.contour), 1)
    return _bent(jnp.concatenate([outline, _beyond(cameras, flesh, _axis_points(parts)[None], seen)], 1))


def _bent(distance: jax.Array) -> jax.Array:
    return _GROSS * jnp.tanh(distance / _GROSS)


def _axis_points(parts: PartFrames) -> jax.Array:
    """Points of the parts' axes (P, 4, 3, N)."""
    share = jnp.asarray(FRACTIONS)[:, None, None]
    return parts.base[:, None] + share * (parts.tip - parts.base)[:, None]


def _beyond(cameras: Cameras, flesh: Flesh, points: jax.Array, seen: SilhouetteSeen) -> jax.Array:
    """How far the parts stick out of the silhouette at points (C or 1, P, 4, 3, N) of their axes, (C, parts * 4, N)."""
    share = jnp.asarray(FRACTIONS)[:, None]
    radius = flesh.radii[:, None, 0] + share * (flesh.radii[:, 1] - flesh.radii[:, 0])[:, None]
    width = radius * jnp.min(flesh.scales, 1)[:, None]
    spread: Cameras = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -2)[..., None, None, :], cameras)
    x, y = project_components(spread, *(points[:, :, :, i] for i in range(3)))  # (C, P, 4, N)
    depth = jnp.linalg.norm(points - cameras.centre[:, None, None], axis=3)
    focal = jnp.mean(jnp.abs(cameras.focal), 1)[:, None, None]
    needed = _DEPTH * width * focal / depth
    scale = seen.scale[:, None, None]
    outside = _bilinear(seen.distance, (x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5) + needed
    return (_SOFT * jax.nn.softplus(outside / _SOFT)).reshape(x.shape[0], -1, x.shape[-1])


def _bilinear(maps: jax.Array, x: jax.Array, y: jax.Array) -> jax.Array:
    """Values of maps (C, H, W, 1) between pixels (C, ..., N); beyond the border, those at the border."""
    count, height, width = maps.shape[:3]
    x, y = jnp.clip(x, 0.0, width - 1.001), jnp.clip(y, 0.0, height - 1.001)
    column, row = jnp.floor(x), jnp.floor(y)
    right, down = x - column, y - row
    first = jnp.arange(count, dtype=jnp.int32).reshape(-1, *(1,) * (x.ndim - 1)) * (height * width)
    place = first + (row * width + column).astype(jnp.int32)
    flat = maps.reshape(-1)
    above, below = ([jnp.take(flat, place + shift + step, mode="clip") for step in (0, 1)] for shift in (0, width))
    upper, lower = (pair[0] + right * (pair[1] - pair[0]) for pair in (above, below))
    return upper + down * (lower - upper)


def _density_last(state: jax.Array, fixed: Any) -> jax.Array:
    """Log-densities (N,)."""
    tree, flesh, cameras, seen, noise, value, weight = fixed
    offset = (_distances_last(state, tree, flesh, cameras, seen) - value) / noise[:, None]
    terms = -0.5 * offset**2 - jnp.log(noise[:, None]) - 0.5 * jnp.log(2 * jnp.pi)
    return jnp.sum(jnp.where(weight > 0, terms, 0.0), (0, 1))


def _value_and_gradient_last(state: jax.Array, fixed: Any) -> tuple[jax.Array, jax.Array]:
    value, pull = jax.vjp(partial(_density_last, fixed=fixed), state)
    return value, pull(jnp.ones_like(value))[0]


def _jacobian_last(state: jax.Array, tree: KinematicTree, flesh: Flesh, cameras: Cameras, seen: SilhouetteSeen) -> jax.Array:
    """Derivatives (C, entries, d, N): a residual depends on one part, which moves as its link does."""
    frames = frames_of(tree, state)
    parts = place_parts(flesh, frames)
    nearest = jnp.argmin(part_distances(computed_once(project_parts(cameras, flesh, parts)), seen.contour), 1)
    pushes = [_outline_pushes(cameras, flesh, parts, seen.contour, nearest), _beyond_pushes(cameras, flesh, parts, seen)]
    force, moment = (jnp.concatenate(each, 1) for each in zip(*pushes, strict=True))
    fixed = jnp.repeat(jnp.arange(len(flesh.links)), len(FRACTIONS))[:, None]
    part = jnp.concatenate([nearest, jnp.broadcast_to(fixed, (len(nearest), len(fixed), nearest.shape[-1]))], 1)
    return derivatives_of_pushes(tree, frames, force, moment, jnp.asarray(flesh.links)[part])


def _outline_pushes(
    cameras: Cameras, flesh: Flesh, parts: PartFrames, contour: jax.Array, nearest: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Gradient of each contour point's residual by a shift and a turn of its nearest part: (C, K, 3, N) each."""
    chosen = _chosen((parts.axes, parts.base, flesh.lengths, flesh.radii, flesh.scales, flesh.balls), nearest)

    def residual(axes: jax.Array, base: jax.Array, sizes: Any, camera: Cameras, point: jax.Array) -> jax.Array:
        """Of one point (2, N) and one part in one camera."""
        length, radii, scales, balls = sizes
        own = PartFrames(axes[None], base[None], (base + axes[:, 2] * length)[None])
        size = replace(flesh, lengths=length[None], radii=radii[None], scales=scales[None], balls=balls[None])
        shape = project_parts(jax.tree.map(lambda leaf: leaf[None], camera), size, own)
        return _bent(part_distances(shape, point[None, None]))

    each = jax.vmap(jax.vmap(residual, in_axes=(0, 0, 0, None, 0)))
    axes, base, *sizes = chosen
    value, pull = jax.vjp(lambda axes, base: each(axes, base, sizes, cameras, contour), axes, base)
    turned, force = pull(jnp.ones_like(value))
    moment = sum(jnp.cross(axes[:, :, :, i], turned[:, :, :, i], axis=2) for i in range(3))
    return force, jnp.cross(base, force, axis=2) + moment


def _chosen(leaves: Any, part: jax.Array) -> Any:
    """Of leaves (P, ..., N or 1) those of the parts (C, K, N): (C, K, ..., N)."""

    def choose(leaf: jax.Array) -> jax.Array:
        number = part.reshape(*part.shape[:2], *(1,) * (leaf.ndim - 2), part.shape[2])
        found = jnp.broadcast_to(leaf[0], (*part.shape[:2], *leaf.shape[1:-1], part.shape[2]))
        for other in range(1, len(leaf)):
            found = jnp.where(number == other, leaf[other], found)
        return found

    return jax.tree.map(choose, leaves)


def _beyond_pushes(cameras: Cameras, flesh: Flesh, parts: PartFrames, seen: SilhouetteSeen) -> tuple[jax.Array, jax.Array]:
    """The same (C, parts * 4, 3, N) of how far the parts stick out; each residual has its own axis point."""
    points = jnp.broadcast_to(_axis_points(parts), (len(cameras.centre), *_axis_points(parts).shape))
    value, pull = jax.vjp(lambda points: _bent(_beyond(cameras, flesh, points, seen)), points)
    (force,) = pull(jnp.ones_like(value))
    force, points = (each.reshape(len(force), -1, *each.shape[3:]) for each in (force, points))
    return force, jnp.cross(points, force, axis=2)


_distances = batched_score(_distances_last, chunk=_CHUNK)
_density = batch_last(_density_last, chunk=_CHUNK)
_value_and_gradient = batch_last(_value_and_gradient_last, chunk=_CHUNK)
_jacobian = batch_last(_jacobian_last, chunk=_CHUNK)


@jax.custom_vjp
def _log_density(state: jax.Array, fixed: Any) -> jax.Array:
    density: jax.Array = _density(state, fixed)
    return density


def _forward(state: jax.Array, fixed: Any) -> tuple[jax.Array, Any]:
    density, gradient = _value_and_gradient(state, fixed)
    return density, (gradient, fixed)


def _backward(residuals: Any, cotangent: jax.Array) -> Any:
    gradient, fixed = residuals
    return gradient * cotangent, jax.tree.map(jnp.zeros_like, fixed)


_log_density.defvjp(_forward, _backward)
