"""A silhouette seen by cameras, as Gaussian residuals: a likelihood that gradient methods and Kalman filters can use.

Kinds of residuals say that the silhouette of the body and that in the image are the same, distances in pixels whose value is
observed to be 0:

* from each of K points on the observed contour to the nearest part of the body in the image, negative inside
  (:mod:`poseppl.motion.geometry.coverage`): the body's outline passes through the contour;
* from points along the axis of each part to the observed silhouette, as far as the part sticks out of it,

      max(0, D(u) + r / 2),

  D being the signed distance to the observed silhouette at the axis point u, and r the part's half-width there.

* if the edges of the image count, from points on the sides of each part to the nearest of them.

Each is saturated by c tanh(. / c), so that a gross error of segmentation counts as much as c and no more; c is a multiple of
the noise, and so as long at the body in images of any size. Neighbours on a contour err alike; their standard deviation has to
be raised by the root of how many do.

The side of a part seen against another colour is an edge in the image: along the silhouette and also, unlike in the
silhouette, where an arm passes before the trunk. Points on both straight sides of each part are looked up in a map of distances
to the image's edges. Distances are cut off at some pixels, which is also the value of a side that is hidden or without
contrast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last, batched_density, batched_score, computed_once
from poseppl.motion.geometry.cameras import Cameras, beside_points, project_components
from poseppl.motion.geometry.coverage import limb_corners, part_distances, project_parts
from poseppl.motion.geometry.flesh import Flesh, PartFrames, parts_of, place_parts
from poseppl.motion.geometry.kinematics import derivatives_of_wrenches, frames_of
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.motion.likelihoods.distance_maps import at_points

FRACTIONS = (0.0, 0.35, 0.7, 1.0)
"""Fractions of each part's axis at which the part is checked for sticking out."""
_CHUNK = 32
_GROSS = 4.0
"""Standard deviations of the noise beyond which a residual counts no more."""
_DEPTH = 0.5
"""Share of a part's half-width by which its axis has to lie inside of the silhouette."""
_SOFT = 0.15
"""Standard deviations of the noise over which a part begins to stick out."""


class SilhouetteSeen(NamedTuple):
    """Observed silhouettes of a frame.

    Attributes:
        contour: Points of the contour (C, K, 2), px.
        distance: Signed distance to the silhouette (C, H, W), in px of the image, negative inside.
        scale: Pixels of ``distance`` to one of the image (C,): centres of pixels are at whole numbers in both.
        edges: Distance to the nearest edge in the image (C, H, W), px of the image, cut off; None if edges do not count.
    """

    contour: Array
    distance: Array
    scale: Array
    edges: Array | None = None


class Silhouettes(dist.Normal):  # type: ignore[misc]
    """Distances between a body's silhouette and the observed one; the value is 0.

    Its batch shape is (C, K + parts * 4), and with edges parts * 6 more.

    Args:
        tree: The body.
        flesh: Its parts.
        cameras: C cameras.
        state: Shape (d,).
        seen: The observed silhouettes.
        noise: Standard deviation of the distances (C,), px.
    """

    is_predictive = False
    """The observed silhouettes are among the arguments: a draw is of no image."""

    def __init__(
        self,
        tree: KinematicTree,
        flesh: Flesh,
        cameras: Cameras,
        state: Array,
        seen: SilhouetteSeen,
        noise: Array,
        *,
        validate_args: Any = None,
    ):
        self.state, self.noise = state, jnp.asarray(noise, state.dtype)
        self.fixed = tree, flesh, cameras, seen, self.noise  # what :meth:`whitened_jacobian` takes to be constant
        distances = silhouette_distances(tree, flesh, cameras, state, seen, self.noise)
        super().__init__(distances, jnp.broadcast_to(self.noise[:, None], distances.shape), validate_args=validate_args)

    def summed_log_prob(self, value: Array, mask: Array | None) -> Array:
        """Log-density of the entries of ``value`` where ``mask`` is true, in one pass; only differentiated by the state."""
        weight = jnp.ones(value.shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        return _log_density(self.state, *self.fixed, value, weight)

    def whitened_jacobian(self, mask: Array | None) -> Array:
        """Derivative of location / scale by ``state``, (C * entries, d), zero where ``mask`` is false; in closed form."""
        weight = jnp.ones(self.batch_shape, self.state.dtype) if mask is None else jnp.asarray(mask, self.state.dtype)
        rows: Array = _jacobian(self.state, *self.fixed)
        return (rows * (weight / self.noise[:, None])[..., None]).reshape(-1, self.state.shape[0])


def silhouette_distances(
    tree: KinematicTree, flesh: Flesh, cameras: Cameras, state: Array, seen: SilhouetteSeen, noise: Array
) -> Array:
    """All residuals (C, entries) of one state (d,), px, of noise (C,); only differentiated by the state, in reverse."""
    distances: Array = _distances(state, tree, flesh, cameras, seen, noise)
    return distances


def _distances_last(
    state: Array, tree: KinematicTree, flesh: Flesh, cameras: Cameras, seen: SilhouetteSeen, noise: Array
) -> Array:
    """Residuals (C, entries, N) of states (d, N)."""
    parts = parts_of(tree, flesh, state)
    shapes = computed_once(project_parts(cameras, flesh, parts))
    outline = jnp.min(part_distances(shapes, seen.contour), 1)
    found = [outline, _beyond(cameras, flesh, _axis_points(parts)[None], seen, noise)]
    if seen.edges is not None:
        beside = edge_distances(cameras, flesh, parts, seen.edges, seen.scale)
        found.append(beside.reshape(len(beside), -1, beside.shape[-1]))
    return _saturated(jnp.concatenate(found, 1), noise)


def _saturated(distance: Array, noise: Array) -> Array:
    """Distances (C, entries, N) of noise (C, N or 1), bounded."""
    most = _GROSS * noise[:, None]
    return most * jnp.tanh(distance / most)


def _axis_points(parts: PartFrames) -> Array:
    """Points of the parts' axes (P, 4, 3, N)."""
    share = jnp.asarray(FRACTIONS)[:, None, None]
    return parts.base[:, None] + share * (parts.tip - parts.base)[:, None]


def _beyond(cameras: Cameras, flesh: Flesh, points: Array, seen: SilhouetteSeen, noise: Array) -> Array:
    """How far the parts stick out of the silhouette at points (C or 1, P, 4, 3, N) of their axes, (C, parts * 4, N)."""
    share = jnp.asarray(FRACTIONS)[:, None]
    radius = flesh.radii[:, None, 0] + share * (flesh.radii[:, 1] - flesh.radii[:, 0])[:, None]
    width = radius * jnp.min(flesh.scales, 1)[:, None]
    spread = beside_points(cameras)
    x, y = project_components(spread, *(points[:, :, :, i] for i in range(3)))  # (C, P, 4, N)
    depth = jnp.linalg.norm(points - cameras.centre[:, None, None], axis=3)
    focal = jnp.mean(jnp.abs(cameras.focal), 1)[:, None, None]
    needed = _DEPTH * width * focal / depth
    outside = at_points(seen.distance, seen.scale, x, y) + needed
    soft = _SOFT * noise[:, None, None]
    return (soft * jax.nn.softplus(outside / soft)).reshape(x.shape[0], -1, x.shape[-1])


def _density_last(
    state: Array,
    tree: KinematicTree,
    flesh: Flesh,
    cameras: Cameras,
    seen: SilhouetteSeen,
    noise: Array,
    value: Array,
    weight: Array,
) -> Array:
    """Log-densities (N,)."""
    offset = (_distances_last(state, tree, flesh, cameras, seen, noise) - value) / noise[:, None]
    terms = -0.5 * offset**2 - jnp.log(noise[:, None]) - 0.5 * jnp.log(2 * jnp.pi)
    return jnp.sum(jnp.where(weight > 0, terms, 0.0), (0, 1))


def _jacobian_last(
    state: Array, tree: KinematicTree, flesh: Flesh, cameras: Cameras, seen: SilhouetteSeen, noise: Array
) -> Array:
    """Derivatives (C, entries, d, N): a residual depends on one part, which moves as its link does."""
    frames = frames_of(tree, state)
    parts = place_parts(flesh, frames)
    nearest = jnp.argmin(part_distances(computed_once(project_parts(cameras, flesh, parts)), seen.contour), 1)
    wrenches = [
        _outline_wrenches((cameras, noise), flesh, parts, seen.contour, nearest),
        _beyond_wrenches((cameras, noise), flesh, parts, seen),
    ]
    own = [jnp.repeat(jnp.arange(len(flesh.links)), len(FRACTIONS))]
    if seen.edges is not None:
        wrenches.append(_edge_wrenches((cameras, noise, seen.edges, seen.scale), flesh, parts))
        own.append(jnp.repeat(jnp.arange(len(flesh.links)), SAMPLES))
    force, moment = (jnp.concatenate(each, 1) for each in zip(*wrenches, strict=True))
    fixed = jnp.concatenate(own)[:, None]
    part = jnp.concatenate([nearest, jnp.broadcast_to(fixed, (len(nearest), len(fixed), nearest.shape[-1]))], 1)
    return derivatives_of_wrenches(tree, frames, force, moment, jnp.asarray(flesh.links)[part])


def _outline_wrenches(
    cameras: tuple[Cameras, Array], flesh: Flesh, parts: PartFrames, contour: Array, nearest: Array
) -> tuple[Array, Array]:
    """Gradient of each contour point's residual by a shift and a turn of its nearest part: (C, K, 3, N) each."""
    chosen = _chosen((parts.axes, parts.base, flesh.lengths, flesh.radii, flesh.scales, flesh.balls), nearest)

    def residual(part: Any, camera: Any, point: Array) -> Array:
        """Residual of one point (2, N) and one part in one camera."""
        lens, noise = camera
        return _saturated(part_distances(project_parts(lens, *_alone(flesh, part)), point[None, None]), noise)

    return _wrenches(residual, chosen, cameras, contour)


def _edge_wrenches(cameras: tuple[Cameras, Array, Array, Array], flesh: Flesh, parts: PartFrames) -> tuple[Array, Array]:
    """Gradients (C, parts * 6, 3, N) of the distances from the parts' sides to the next edge."""
    count, cameras_too = len(flesh.links), len(cameras[0].centre)
    every = (parts.axes, parts.base, flesh.lengths, flesh.radii, flesh.scales, flesh.balls)
    each = jax.tree.map(
        lambda leaf: jnp.broadcast_to(jnp.repeat(leaf, SAMPLES, 0), (cameras_too, count * SAMPLES, *leaf.shape[1:])), every
    )
    fraction = jnp.tile(jnp.asarray(EDGE_FRACTIONS), 2 * count)
    second = jnp.tile(jnp.arange(SAMPLES) >= len(EDGE_FRACTIONS), count)
    sample = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (cameras_too, count * SAMPLES)), (fraction, second))

    def residual(part: Any, camera: Any, sample: tuple[Array, Array]) -> Array:
        """Residual of one point on one part's sides in one camera."""
        (lens, noise, edges, scale), (fraction, second) = camera, sample
        sides = edge_distances(lens, *_alone(flesh, part), edges, scale, fraction[None])
        return _saturated(jnp.where(second, sides[:, :, 1], sides[:, :, 0]), noise)

    return _wrenches(residual, each, cameras, sample)


def _alone(flesh: Flesh, part: Any) -> tuple[Flesh, PartFrames]:
    """One part as the flesh and frames of a body, axes (3, 3, N), base (3, N), and so on."""
    axes, base, length, radii, scales, balls = part
    size = replace(flesh, lengths=length[None], radii=radii[None], scales=scales[None], balls=balls[None])
    return size, PartFrames(axes[None], base[None], (base + axes[:, 2] * length)[None])


def _wrenches(residual: Any, parts: Any, cameras: Any, data: Any) -> tuple[Array, Array]:
    """Gradients of residuals (C, K, N) by a shift and a turn about the world's origin of the part of each: (C, K, 3, N) each.

    Args:
        residual: `(part, camera, datum) -> residual`, the camera with a leading axis of 1.
        parts: Axes, base and sizes, leaves (C, K, ..., N or 1).
        cameras: Data of each camera, leaves (C, ...).
        data: Data of each residual, leaves (C, K, ...).
    """
    (axes, base), sizes = parts[:2], parts[2:]
    single = jax.tree.map(lambda leaf: leaf[:, None], cameras)
    each = jax.vmap(jax.vmap(residual, in_axes=(0, None, 0)))
    value, pull = jax.vjp(lambda axes, base: each((axes, base, *sizes), single, data), axes, base)
    turned, force = pull(jnp.ones_like(value))
    moment = sum(jnp.cross(axes[:, :, :, i], turned[:, :, :, i], axis=2) for i in range(3))
    return force, jnp.cross(base, force, axis=2) + moment


def _chosen(leaves: Any, part: Array) -> Any:
    """Select the parts (C, K, N) from leaves (P, ..., N or 1): (C, K, ..., N)."""

    def choose(leaf: Array) -> Array:
        number = part.reshape(*part.shape[:2], *(1,) * (leaf.ndim - 2), part.shape[2])
        found = jnp.broadcast_to(leaf[0], (*part.shape[:2], *leaf.shape[1:-1], part.shape[2]))
        for other in range(1, len(leaf)):
            found = jnp.where(number == other, leaf[other], found)
        return found

    return jax.tree.map(choose, leaves)


def _beyond_wrenches(
    cameras: tuple[Cameras, Array], flesh: Flesh, parts: PartFrames, seen: SilhouetteSeen
) -> tuple[Array, Array]:
    """Gradients (C, parts * 4, 3, N) of how far the parts stick out; each residual has its own axis point."""
    lenses, noise = cameras
    points = jnp.broadcast_to(_axis_points(parts), (len(lenses.centre), *_axis_points(parts).shape))
    value, pull = jax.vjp(lambda points: _saturated(_beyond(lenses, flesh, points, seen, noise), noise), points)
    (force,) = pull(jnp.ones_like(value))
    force, points = (each.reshape(len(force), -1, *each.shape[3:]) for each in (force, points))
    return force, jnp.cross(points, force, axis=2)


_distances = batched_score(_distances_last, chunk=_CHUNK)
_log_density = batched_density(_density_last, chunk=_CHUNK)
_jacobian = batch_last(_jacobian_last, chunk=_CHUNK)


EDGE_FRACTIONS = (0.2, 0.5, 0.8)
"""Fractions of each side at which the distance to the next edge is looked up."""
SAMPLES = 2 * len(EDGE_FRACTIONS)


def edge_distances(
    cameras: Cameras,
    flesh: Flesh,
    parts: PartFrames,
    edges: Array,
    scale: Array,
    fractions: Sequence[float] | Array = EDGE_FRACTIONS,
) -> Array:
    """Distances (C, P, 2 * fractions, N), px: first those of one side, then those of the other.

    Args:
        cameras: C cameras, leaves (C, ..., N or 1).
        flesh: Sizes of P parts.
        parts: Their positions and axes, leaves (P, ..., N).
        edges: Distances to the nearest edge (C, H, W, 1), px of the image.
        scale: Pixels of the maps to one of the image (C, 1).
        fractions: Fractions of the sides, from base to tip.
    """
    corners = limb_corners(cameras, flesh, parts)  # (C, P, 4, 2, N): base, tip, tip, base
    share = jnp.asarray(fractions)[:, None, None]
    sides = [
        corners[:, :, None, base] + share * (corners[:, :, tip] - corners[:, :, base])[:, :, None]
        for base, tip in ((0, 1), (3, 2))
    ]
    points = jnp.concatenate(sides, 2)
    return at_points(edges, scale, points[:, :, :, 0], points[:, :, :, 1])
