"""The image cost of Sminchisescu and Triggs (2001, section 3.1) as residuals, with its gradient and curvature.

Nodes of a part, N of them, are on its occluding contour (two of each of some rings) or inside, and cost

    visible contour node    1/2 sum over edges e on its normal of w_e rho(d_e^2 / sigma^2) + w_0 nu / 2,
    visible inner node      1/2 rho((u + v(u) - r)^T W(u) (u + v(u) - r) / sigma_f^2),
    back-facing             nu,
    occluded                k nu,   k > 1,

summed over the part's nodes and divided by N, and summed over parts. d_e is the offset of an edge along the contour's normal
within a window. w_e is its importance: its energy, larger at motion boundaries, falling to 0 at the window's ends, and
normalised with w_0 for "no edge at all" to a sum of 1. u is the node's position in the previous frame, for a given pose then,
and v the flow there. W is the flow's precision by direction (:mod:`poseppl.motion.vision.image_cues`), and r the node's
position now. rho is a robust potential of strength nu: Leclerc's for edges, of which another one may be meant, the Lorentzian
for flow, which attracts from a distance.

Departures from the paper: a visible node without edges costs nu / 2, because otherwise clutter would cost more than its
absence. So does a node of a ring that is seen as a whole, which has no contour; otherwise limbs that point to the eye would
cost least. Facing and occlusion set in smoothly, with the ellipsoids of the parts as occluders. The paper does not assign the
potentials to the cues. A weight multiplies the cost: the number of independent measurements that a part is worth, because
errors of neighbouring nodes are correlated.

Each cost c enters as a residual sqrt(2 c), of the offset's sign, that is normal of scale 1 and observed to be 0. So the density
is that of the cost up to a constant, and every method for Gaussian data can use it. The curvature is that of the paper's
section 4.1: rho' + 2 rho'' s along an error and rho' across it, 0 where that is negative, with weights and visibility taken as
constant. Gauss-Newton's of the robust residuals would be rho'^2 s / rho along an error: 0.47 instead of 0 for Leclerc's at
s = 2, nu = 4. Nodes without an assignment keep Gauss-Newton's. Gradients keep the assigned edges and their positions fixed, as
the paper's do; the curvature keeps the occlusion by other parts fixed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro.distributions as dist
from jax import Array

from poseppl.motion.geometry.kinematics import frames_of
from poseppl.motion.likelihoods.distance_maps import at_points
from poseppl.program import Leclerc, Lorentzian, RobustError
from poseppl_models.sminchisescu_triggs.contours import (
    ContourNodes,
    contour_nodes,
    edges_along_normals,
    hidden,
    nodes_facing,
    project_point,
)
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics, local_nodes, part_axes, place_in

Parts = tuple[Array, Array]
"""Axes (P, 3, 3, N) and centres (P, 3, N), mm, of parts in the world."""
_RINGS = np.linspace(-1.25, 1.25, 7)
_MERIDIANS = 2 * np.pi * np.arange(12) / 12
_INNER = (np.array([-0.7, 0.0, 0.7]), 2 * np.pi * np.arange(6) / 6)
NODES = 2 * len(_RINGS) + len(_INNER[0]) * len(_INNER[1])
"""N, nodes of a part."""
ASSIGNMENTS = 3
"""Edges that a contour node may have, as a rule."""
ENTRIES = 2 * len(_RINGS) * ASSIGNMENTS + 2 * len(_INNER[0]) * len(_INNER[1]) + 1
"""Residuals of a part with so many edges a node."""
_TINY = 1e-10
"""Least squared residual, whose root has a slope."""


class CostSettings(NamedTuple):
    """The cost's numbers.

    Attributes:
        window: How far along its normal to both sides a contour node looks for edges, steps.
        fineness: Steps to a standard deviation of edges.
        assignments: How many edges it may have.
        threshold: Energy that an edge has to have.
        unassigned: w_0 before weights are normalised, an edge of full energy at a motion boundary having 1.
        boundary: Share of an edge's importance that it has only at motion boundaries.
        strength: nu.
        occluded: k, above 1 in the paper. Without flow that is much: a limb that is truly hidden then costs more than one
            in the open without a single edge, and poses near the truth may cost less than it; at 0.5 both cost the same.
        lean: Cosine between surface and view over which facing sets in.
        softness: Millimetres over which occlusion sets in.
    """

    window: int = 8
    fineness: float = 2.0
    assignments: int = ASSIGNMENTS
    threshold: float = 0.15
    unassigned: float = 0.25
    boundary: float = 0.5
    strength: float = 4.0
    occluded: float = 1.25
    lean: float = 0.15
    softness: float = 8.0


class ImageSeen(NamedTuple):
    """The data of a frame from C cameras.

    Attributes:
        energy: Edge energy (C, H, W), in [0, 1].
        boundary: Motion boundaries (C, H, W), in [0, 1].
        flow: From the frame before to this one, at the frame before (C, 2, H, W), px of the image.
        trust: How far the flow can be believed: symmetric roots of W (C, 3, H, W), xx, xy and yy, 0 without a frame before.
        scale: Pixels of the maps to one of the image (C,).
        previous: The pose in the frame before (d,): of a tracker its estimate then; not read where nothing is trusted.
    """

    energy: Array
    boundary: Array
    flow: Array
    trust: Array
    scale: Array
    previous: Array


class CostNoise(NamedTuple):
    """Standard deviations of edges and of flow (C,), px, and the weight of each camera (C,), 0 for none."""

    edges: Array
    flow: Array
    weight: Array


def robust_root(potential: type[RobustError], squared: Array, strength: float) -> Array:
    """sqrt(rho(s) / s) of a potential of strength nu: a residual times this has rho as its square."""
    squared = jnp.maximum(squared, _TINY)
    return jnp.sqrt(potential(dist.Normal(0.0, 1.0), strength).potential(squared) / squared)


def curvature_roots(potential: type[RobustError], squared: Array, strength: float) -> tuple[Array, Array]:
    """Roots of the curvature of 1/2 rho across an error of unit weight and along it, 0 where the curvature is negative."""
    first, second = potential(dist.Normal(0.0, 1.0), strength).derivatives(squared)
    return jnp.sqrt(first), jnp.sqrt(jnp.maximum(first + 2 * second * squared, 0.0))


class _Assigned(NamedTuple):
    """Edges assigned to contour nodes: where these were and their normals (P, K, 2, N), offsets and importance (P, K, E, N)."""

    image: Array
    normals: Array
    offset: Array
    importance: Array


def _per_camera(
    settings: CostSettings,
    camera: Any,
    flesh: Superquadrics,
    own: Parts,
    others: Parts,
    assigned_at: Parts,
    before: Parts,
    curved: bool,
) -> Array:
    """Residuals (P, entries, N) of one camera: of edges, of flow, and one for all that has no assignment.

    Args:
        settings: The settings.
        camera: Lens, what it saw, noise: leaves without an axis of cameras.
        flesh: The parts.
        own: The parts in the world, whose nodes they move.
        others: The same again, as occluders.
        assigned_at: The same again, where edges are assigned.
        before: Positions of the inner nodes by the flow (P, K, 2, N or 1), and roots of its weights (P, K, 3, N or 1).
        curved: Whether residuals are those whose derivatives make the curvature.
    """
    lens, _, noise = camera
    edges, missed = _edge_residuals(settings, camera, flesh, own, others, assigned_at, curved)
    inner = place_in(*own, local_nodes(flesh, *(jnp.asarray(angles, float) for angles in _INNER)))
    facing = nodes_facing(lens, inner)
    points, front = (leaf.reshape(leaf.shape[0], -1, *leaf.shape[3:]) for leaf in (inner.points, facing))
    front = jax.nn.sigmoid(front / (0.5 * settings.lean))
    behind = hidden(flesh, *others, lens.centre, points, settings.softness)
    x, y = jnp.moveaxis((before[0] - project_point(lens, points)) / noise.flow, 2, 0)
    xx, xy, yy = jnp.moveaxis(before[1], 2, 0)
    offset = jnp.stack([xx * x + xy * y, xy * x + yy * y], 2)
    seen = jnp.sqrt(front * (1 - behind) + _TINY)
    flow = _flow_residuals(offset, seen, settings.strength, curved).reshape(len(points), -1, points.shape[-1])
    lost = (1 - front) + settings.occluded * front * behind
    rest = missed + settings.strength * jnp.sum(lost, 1, keepdims=True)
    scale = jnp.sqrt(jnp.maximum(noise.weight, _TINY) / NODES)
    return scale * jnp.concatenate([edges, flow, jnp.sqrt(2 * rest)], 1)


def _flow_residuals(offset: Array, seen: Array, strength: float, curved: bool) -> Array:
    """Residuals (P, K, 2, N) of whitened offsets that are so visible (P, K, N)."""
    squared = jnp.sum(offset**2, 2)
    if not curved:
        return offset * (robust_root(Lorentzian, squared, strength) * seen)[:, :, None]
    across, along, unit = jax.lax.stop_gradient(
        (*curvature_roots(Lorentzian, squared, strength), offset / jnp.sqrt(squared + _TINY)[:, :, None])
    )
    inward = jnp.sum(unit * offset, 2, keepdims=True)
    bent = across[:, :, None] * offset + (along - across)[:, :, None] * unit * inward
    return bent * jax.lax.stop_gradient(seen)[:, :, None]


def _edge_residuals(
    settings: CostSettings, camera: Any, flesh: Superquadrics, own: Parts, others: Parts, assigned_at: Parts, curved: bool
) -> tuple[Array, Array]:
    """Residuals (P, K * E, N) of assigned edges, and the cost (P, 1, N) of contour nodes without, or occluded."""
    lens, seen, noise = camera
    contour = _contour(settings, lens, flesh, own)
    at = contour if assigned_at is own else _contour(settings, lens, flesh, assigned_at)
    step = noise.edges / settings.fineness
    found = jax.lax.stop_gradient(_assigned(settings, seen, at, step))
    offset = found.offset - jnp.sum(found.normals * (contour.image - found.image), 2)[:, :, None]  # (P, K, E, N)
    inside = jnp.maximum(1 - (offset / (step * (settings.window + 1))) ** 2, 0.0)
    weight = found.importance * inside**2
    total = settings.unassigned + jnp.sum(weight, 2, keepdims=True)
    behind = hidden(flesh, *others, lens.centre, contour.points, settings.softness)
    visible = contour.share * (1 - behind)
    deviation = offset / noise.edges
    root = jnp.sqrt(visible[:, :, None] * weight / total + _TINY)
    if curved:
        residuals = deviation * jax.lax.stop_gradient(root * curvature_roots(Leclerc, deviation**2, settings.strength)[1])
    else:
        residuals = deviation * root * robust_root(Leclerc, deviation**2, settings.strength)
    missed = 0.5 * (visible * settings.unassigned / total[:, :, 0] + 1 - contour.share)
    missed = missed + settings.occluded * contour.share * behind
    cost = settings.strength * jnp.sum(missed, 1, keepdims=True)
    return residuals.reshape(len(residuals), -1, residuals.shape[-1]), cost


def _contour(settings: CostSettings, lens: Any, flesh: Superquadrics, parts: Parts) -> ContourNodes:
    rings, meridians = jnp.asarray(_RINGS, float), jnp.asarray(_MERIDIANS, float)
    return contour_nodes(lens, flesh, *parts, rings, meridians, lean=settings.lean)


def _assigned(settings: CostSettings, seen: Any, contour: ContourNodes, step: Array) -> _Assigned:
    """Search for edges along the normals of a contour."""
    found = edges_along_normals(
        seen.energy,
        seen.scale,
        contour.image,
        contour.normals,
        window=settings.window,
        number=settings.assignments,
        threshold=settings.threshold,
        step=step,
    )
    place = contour.image[:, :, None] + found.offset[:, :, :, None] * contour.normals[:, :, None]
    moving = _looked_up(seen.boundary, seen.scale, place)
    importance = found.strength * (1 - settings.boundary * (1 - moving))
    return _Assigned(contour.image, contour.normals, found.offset, importance)


def _looked_up(image: Array, scale: Array, place: Array) -> Array:
    """Values (..., N) of a map (H, W, 1) of one camera at image points (..., 2, N)."""
    return at_points(image[None], scale[None], place[None, ..., 0, :], place[None, ..., 1, :])[0]


def _expected_by_flow(lens: Any, seen: Any, flesh: Superquadrics, before: Parts) -> Parts:
    """Expected positions of the inner nodes of the frame before (P, K, 2, N), and roots of the weights (P, K, 3, N)."""
    inner = place_in(*before, local_nodes(flesh, *(jnp.asarray(angles, float) for angles in _INNER)))
    points = inner.points.reshape(len(inner.points), -1, *inner.points.shape[3:])
    image = project_point(lens, points)
    moved = jnp.stack([_looked_up(plane, seen.scale, image) for plane in seen.flow], 2)
    return image + moved, jnp.stack([_looked_up(plane, seen.scale, image) for plane in seen.trust], 2)


def residuals_of(
    settings: CostSettings,
    fixed: Any,
    own: Parts,
    others: Parts | None = None,
    assigned_at: Parts | None = None,
    *,
    curved: bool = False,
) -> Array:
    """Residuals (C, P, entries, N) of parts in the world.

    Args:
        settings: The settings.
        fixed: Tree, flesh, cameras, what was seen, and noise, batch last.
        own: Axes (P, 3, 3, N) and centres (P, 3, N) of the parts.
        others: The same of the parts as occluders, where these are to differ.
        assigned_at: The same of the parts where edges are assigned to their contours, where these are to differ.
        curved: Whether they are to have the squares of their derivatives, not their own, add up to the cost's curvature.
    """
    others, assigned_at = (own if each is None else each for each in (others, assigned_at))
    tree, flesh, cameras, seen, noise = fixed
    before = part_axes(flesh, frames_of(tree, seen.previous))
    found = []
    for number in range(cameras.centre.shape[0]):
        each = jax.tree.map(lambda leaf, number=number: leaf[number], seen._replace(previous=seen.previous[None]))
        lens, spread = jax.tree.map(lambda leaf, number=number: leaf[number], (cameras, noise))
        expected = _expected_by_flow(lens, each, flesh, before)
        found.append(_per_camera(settings, (lens, each, spread), flesh, own, others, assigned_at, expected, curved))
    return jnp.stack(jnp.broadcast_arrays(*found))
