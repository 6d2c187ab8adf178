"""Parts of a body that do not run through each other: the prior p_pa of Sminchisescu and Triggs (2001, section 3.2).

    f_pa = w sum over pairs of parts that do not meet at a joint, of the mean over nodes of exp(-f |f|^(p - 1)),

f being the implicit surface of the other part in units of some millimetres. The paper gives neither p nor that unit, nor says
where f is evaluated. Here p = 2, 15 mm, both parts' nodes in the other's surface, and w = 20: flesh that touches at one node
of twenty costs 1.

Most pairs are far apart in any pose. So points on the axis of every part are first expressed in the frame of every other part,
in units of its half-axes, enlarged by the part's own. Only the pairs that are closest by this measure count. Only the nodes
nearest to the other part's ellipsoid count: 45 mm outside of it the potential is e^-9. A force along the gradient of the
potential acts on each node, and its opposite on the other part, so that all derivatives follow from one wrench for each pair
(:func:`poseppl.motion.geometry.kinematics.derivatives_of_wrenches`).

>>> import jax.numpy as jnp
>>> from poseppl_models.sminchisescu_triggs.body import superquadric_body
>>> body = superquadric_body()
>>> residuals = non_penetration_residuals(body.flesh.names)
>>> bool(jnp.sum(residuals(jnp.asarray(body.rest, float), body.tree, body.flesh) ** 2) < 1)
True

A point of the part's frame is unbent and untapered; of what is left, (x, y, z), the gauge

    G = ((|x / a|^(2/e_2) + |y / b|^(2/e_2))^(e_2/e_1) + |z / c|^(2/e_1))^(e_1/2)

is 1 on the surface, less inside, and grows in proportion to the distance from the centre (Barr's inside-outside function is
G^(2/e_1)). The implicit surface is f = 0 for

    f = (G - 1) min(a, b, c),

in mm, negative inside: of a convex part without tapering and bending never more than the distance from the surface, and that
distance across its thinnest direction.

>>> import jax
>>> from poseppl.motion.geometry import Joint, Marker, kinematic_tree
>>> from poseppl_models.sminchisescu_triggs.superquadrics import Superquadric, superquadrics_of
>>> tree = kinematic_tree([Joint("hip", None, (0, 0, 0), "X")], [Marker("knee", "hip", (0, 0, -400))])
>>> egg = superquadrics_of(tree, [Superquadric("egg", "hip", (50.0, 50.0, 100.0))])
>>> last = jax.tree.map(lambda leaf: leaf[..., None], egg)
>>> places = jnp.array([[[60.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 100.0]]])[..., None]
>>> [round(float(f), 1) for f in surface_distances(last, places)[0, :, 0]]
[10.0, -50.0, 0.0]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.batch_last import batched_residuals
from poseppl.motion.geometry.kinematics import derivatives_of_wrenches, frames_of
from poseppl_models.bodies.joint_names import neighbours_in
from poseppl_models.sminchisescu_triggs.superquadrics import Superquadrics, local_nodes, part_axes

SOFTNESS = 15.0
"""Unit of the implicit surfaces, mm."""
DECAY = 2.0
"""p."""
WEIGHT = 20.0
"""w."""
NEAREST = 24
"""Pairs that count in a pose, at most."""
NEAREST_NODES = 128
"""Nodes that count in a pose, at most, of 20 a pair."""
_TINY = 1e-8
_AXIS = np.linspace(-0.8, 0.8, 5)
"""Points of a part's axis, in half-axes."""
_LATITUDES = np.array([-1.2, -0.55, 0.0, 0.55, 1.2])
_LONGITUDES = np.arange(4) * np.pi / 2
_CHAINS = (
    ("pelvis", "chest", "neck", "head"),
    ("neck", "upper_arm"),
    ("chest", "upper_arm", "forearm", "hand"),
    ("pelvis", "thigh", "shank", "foot"),
)
"""Parts that meet: each with the next."""

Penalty = Callable[[Array, KinematicTree, Superquadrics], Array]
"""A state (d,), the tree and the flesh to residuals, with a gradient by the state."""


class _Parts(NamedTuple):
    """Parts, leaves (P, ..., N or 1): shapes, axes as columns and centres in the world, and nodes in the parts' own frames."""

    flesh: Superquadrics
    axes: Array
    centres: Array
    nodes: Array


def non_penetration_residuals(names: Sequence[str], nearest: int = NEAREST, nodes: int = NEAREST_NODES) -> Penalty:
    """Write the cost as residuals, one for each pair that counts, whose squares add up to 2 f_pa.

    Args:
        names: Names of the P parts; they identify parts that meet at a joint.
        nearest: Pairs that count, those that are closest to each other.
        nodes: Nodes of these that count, those that are closest to the other part.
    """
    pairs = np.array(apart(names), int).reshape(-1, 2)

    def residuals(state: Array, tree: KinematicTree, flesh: Superquadrics) -> tuple[Array, Array]:
        count = state.shape[-1]
        if not len(pairs):
            return jnp.zeros((0, count), state.dtype), jnp.zeros((0, *state.shape), state.dtype)
        frames = frames_of(tree, state)
        places = local_nodes(flesh, jnp.asarray(_LATITUDES, float), jnp.asarray(_LONGITUDES, float)).points
        parts = _Parts(flesh, *part_axes(flesh, frames), places.reshape(len(places), -1, *places.shape[3:]))
        chosen = jnp.asarray(pairs)[_closest(parts, pairs, nearest)]  # (K, N, 2)
        wall, guest = (_taken(parts, chosen[..., side]) for side in range(2))
        found, force, moment = _repulsion(wall, guest, nodes)
        links = jnp.asarray(flesh.links)[chosen]
        of_guest, of_wall = (derivatives_of_wrenches(tree, frames, force, moment, links[..., side]) for side in (1, 0))
        residual = jnp.sqrt(2 * WEIGHT * found + _TINY)
        return residual, WEIGHT * (of_guest - of_wall) / residual[:, None]

    return batched_residuals(residuals)


def _closest(parts: _Parts, pairs: np.ndarray[Any, Any], number: int) -> Array:
    """The pairs that come closest (K, N), in their order: by the guest's axis in the wall's ellipsoid, which is made wider."""
    wall, guest = pairs.T
    shape, ends = parts.flesh.half_axes[wall], parts.flesh.half_axes[guest]
    along = jnp.asarray(_AXIS, ends.dtype)[:, None, None] * (parts.axes[guest, :, 2] * ends[:, 2, None])[:, None]
    seen = _inverse(parts.axes[wall], along + (parts.centres[guest] - parts.centres[wall])[:, None])
    wide = (shape + jnp.maximum(ends[:, 0], ends[:, 1])[:, None])[:, None]
    nearness = -jnp.min(jnp.sum((seen / wide) ** 2, 2), 1)
    return jnp.sort(jax.lax.top_k(nearness.T, min(number, len(pairs)))[1], 1).T


def _repulsion(wall: _Parts, guest: _Parts, number: int) -> tuple[Array, Array, Array]:
    """Potentials (K, N) of guests' nodes, and gradients by a shift of the guest and by its turn about the world's origin."""
    turned = jnp.sum(guest.axes[:, None] * guest.nodes[:, :, None], 3)
    points = _inverse(wall.axes, turned + (guest.centres - wall.centres)[:, None])
    found, forces = _potentials(wall, points, number)
    about_centre = jnp.sum(jnp.cross(points, forces, axis=2), 1)
    force, moment = (jnp.sum(wall.axes * each[:, None], 2) for each in (jnp.sum(forces, 1), about_centre))
    return found, force, moment + jnp.cross(wall.centres, force, axis=1)


def _potentials(wall: _Parts, points: Array, number: int) -> tuple[Array, Array]:
    """Potentials (K, N) at points (K, n, 3, N) of the walls' frames, and their gradients (K, n, 3, N); far points have none."""
    pairs, nodes, _, count = points.shape
    shape = wall.flesh.half_axes[:, None]
    outside = (jnp.sqrt(jnp.sum((points / shape) ** 2, 2)) - 1) * jnp.min(shape, 2)
    nearest = jax.lax.top_k(-outside.reshape(-1, count).T, min(number, pairs * nodes))[1].T  # (M, N)
    near = jnp.take_along_axis(points.reshape(-1, 3, count), nearest[:, None], 0)
    flesh = _taken(wall, nearest // nodes).flesh
    found, pull = jax.vjp(lambda at: penetration(flesh, at[:, None], softness=SOFTNESS, decay=DECAY), near)
    each = jnp.concatenate([found[:, None], pull(jnp.ones_like(found))[0]], 1) / nodes
    everywhere = jnp.zeros((pairs * nodes, 4, count), points.dtype)
    everywhere = jnp.put_along_axis(everywhere, jnp.broadcast_to(nearest[:, None], each.shape), each, 0, inplace=False)
    found, forces = everywhere[:, 0], everywhere[:, 1:]
    return jnp.sum(found.reshape(pairs, nodes, count), 1), forces.reshape(points.shape)


def _inverse(axes: Array, vectors: Array) -> Array:
    """Vectors (K, n, 3, N) of the world in frames with such axes (K, 3, 3, N)."""
    return jnp.sum(axes[:, None] * vectors[..., None, :], 2)


def _taken(parts: _Parts, index: Array) -> _Parts:
    """The parts of such numbers (K, N)."""

    def rows(leaf: Array) -> Array:
        whole = jnp.broadcast_to(leaf, (*leaf.shape[:-1], index.shape[-1]))
        return jnp.take_along_axis(whole, index.reshape(len(index), *[1] * (leaf.ndim - 2), -1), 0)

    taken: _Parts = jax.tree.map(rows, parts)
    return taken


def apart(names: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Ordered pairs of parts that do not meet at a joint; ``_l`` and ``_r`` mark those of one side."""
    meet, count = neighbours_in(_CHAINS), len(names)
    return tuple((i, j) for i in range(count) for j in range(count) if i != j and not meet(names[i], names[j]))


_MIN = 1e-6
_NEAREST = 0.05
"""Points beyond the centre of a part's arc are taken to lie at so much of its radius before it."""
_STEEP = 8.0
"""Exponent of a potential above which it grows linearly."""
_SMALL = 1e-3
"""Turns below which atan(q) / q is its series."""


def surface_distances(flesh: Superquadrics, points: Array) -> Array:
    """The implicit surface f (P, K, N), mm, at points (P, K, 3, N) of the parts' own frames."""
    x, y, z = _straightened(flesh, *(points[:, :, i] for i in range(3)))
    a, b, c = (flesh.half_axes[:, i, None] for i in range(3))
    along, across = (2 / flesh.exponents[:, i, None] for i in range(2))
    gauge = _norm(_norm(jnp.abs(x) / a, jnp.abs(y) / b, across), jnp.abs(z) / c, along)
    return (gauge - 1) * jnp.min(flesh.half_axes, 1)[:, None]


def penetration(flesh: Superquadrics, points: Array, *, softness: Array | float, decay: float) -> Array:
    """Repulsive potentials (P, N) of parts (Sminchisescu and Triggs 2001, section 3.2).

    Each is the mean over points of exp(-f |f|^(p - 1)), f being the implicit surface in units of the softness: 1 at the
    surface, as good as 0 some softnesses outside, and growing fast inside. Above e^8 it goes on along its tangent, in
    -f |f|^(p - 1), which float32 can follow.

    Args:
        flesh: P parts that repel, leaves (P, ..., N or 1).
        points: The points that each repels (P, K, 3, N), mm, in its own frame.
        softness: Unit of f, mm.
        decay: p.
    """
    f = surface_distances(flesh, points) / softness
    exponent = -f * jnp.maximum(jnp.abs(f), _MIN) ** (decay - 1)
    return jnp.mean(jnp.exp(jnp.minimum(exponent, _STEEP)) * (1 + jnp.maximum(exponent - _STEEP, 0.0)), 1)


def _straightened(flesh: Superquadrics, x: Array, y: Array, z: Array) -> tuple[Array, ...]:
    """Coordinates (P, K, N) before the part was tapered and bent."""
    towards = flesh.bends[:, 1, None]
    cosine, sine = jnp.cos(towards), jnp.sin(towards)
    c = flesh.half_axes[:, 2, None]
    curvature = flesh.bends[:, 0, None] / (2 * c)
    r = cosine * x + sine * y
    left = jnp.maximum(1 - curvature * r, _NEAREST)
    turn = curvature * z / left
    root = jnp.sqrt(left**2 + (curvature * z) ** 2)
    straight = (2 * r - curvature * (r * r + z * z)) / (1 + root)  # 1 / k - its distance from the arc's centre
    height = z / left * _atan_ratio(turn)
    wide = jnp.clip(height / c, -1, 1)
    x, y = x + cosine * (straight - r), y + sine * (straight - r)
    return x / (1 + flesh.tapers[:, 0, None] * wide), y / (1 + flesh.tapers[:, 1, None] * wide), height


def _atan_ratio(q: Array) -> Array:
    """atan(q) / q, for 0 too."""
    small = jnp.abs(q) < _SMALL
    safe = jnp.where(small, 1.0, q)
    return jnp.where(small, 1 - q * q / 3, jnp.arctan(safe) / safe)


def _norm(u: Array, v: Array, power: Array) -> Array:
    """(u^p + v^p)^(1/p) of numbers that are not negative, without overflow."""
    most = jnp.maximum(jnp.maximum(u, v), _MIN)
    shares = sum(jnp.exp(power * jnp.log(jnp.maximum(each / most, _MIN))) for each in (u, v))
    return most * jnp.exp(jnp.log(shares) / power)
