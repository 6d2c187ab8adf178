"""Kinematic jumps, other poses of the limbs that look the same to a camera, and on which side a hinge is bent.

A limb has two bones, from a ball joint at a over a hinge at b to an end at c. It looks the same whether each bone leans towards
the camera or away (Sminchisescu and Triggs 2001, section 1.2, and 2003, doi:10.1109/CVPR.2003.1211339). The line of sight of b
meets the sphere around a, with the bone's length as radius, in two points; so does that of c around b. With the line from the
camera's centre o in the direction u through the point b, the other point is

    b' = o + (2 u . (a - o) - |b - o|) u,

for a distant camera b mirrored about the image plane through a. The hinge's angle follows from the distance of a and c:
of the two solutions, the one on the hinge's former side. The ball's rotation follows from the triangle a, b, c. Each such
limb has three poses beside its own; one of a single bone, such as a head, has one, by the shortest turn. A line of
sight that misses a sphere leaves the bone pointing to the point of the sphere that is nearest to it.

A pose without joint limits may be either, or change from one to the other
where the limb is straight. People have the pose whose limb bends to the same side as at rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.compilation import jit_lightly
from poseppl.motion.geometry.cameras import Cameras
from poseppl.motion.geometry.kinematics import Frames, frames_of
from poseppl.motion.geometry.tree import KinematicTree
from poseppl.particles.weights import weighted_mean

_STRAIGHT = 1e-3
"""Sine of the angle between two bones below which a limb counts as straight: its twist then stays what it was."""


class Limb(NamedTuple):
    """One or two bones of a tree.

    Attributes:
        ball: Link of the ball joint, which turns about Z, Y and X.
        marker: The marker at the end.
        hinge: Link of the hinge, which turns about one axis; None for a single bone.
        axis: That axis, 0 to 2.
    """

    ball: int
    marker: int
    hinge: int | None = None
    axis: int = 0


def limbs_of(tree: KinematicTree) -> tuple[Limb, ...]:
    """The limbs of a tree: ball joints of one link (`"ZYX"`), but the root, that bear a hinge of one link, or nothing.

    The last bone has a marker away from its joint. Hinges have one axis.
    """
    limbs = []
    for link, (parent, angles) in enumerate(zip(tree.parents, tree.angle_index, strict=True)):
        markers = [m for m, on in enumerate(tree.marker_link) if on == link and any(tree.marker_pattern[m])]
        turning = [axis for axis, index in zip((2, 1, 0), angles, strict=True) if index >= 0]
        if parent < 0 or not markers:
            continue
        if len(turning) == 3 and link not in tree.parents:
            limbs.append(Limb(link, markers[-1]))
        elif len(turning) == 1 and min(tree.angle_index[parent]) >= 0 and parent > 0 and any(tree.offset_pattern[link]):
            limbs.append(Limb(parent, markers[-1], link, turning[0]))
    return tuple(limbs)


def kinematic_jumps(tree: KinematicTree) -> Callable[[Array, Any], Array]:
    """Other poses of each limb, for states of this tree's coordinates.

    Args:
        tree: Its limbs are sought once; lengths and cameras are those of the inputs.

    Returns:
        A function of a state (d,) and of inputs with fields `tree` and `cameras`, which gives states (n, d), each with one limb
        changed in the sight of the first camera.

    Raises:
        ValueError: The tree has no limb.
    """
    limbs = limbs_of(tree)
    if not limbs:
        raise ValueError("the tree has no limb. Expected a joint of axes ZYX that bears a joint of one axis with a marker.")

    def jump(state: Array, inputs: Any) -> Array:
        return jnp.concatenate([limb_poses(inputs.tree, inputs.cameras, limb, state) for limb in limbs])

    return jump


def limb_poses(tree: KinematicTree, cameras: Cameras, limb: Limb, state: Array) -> Array:
    """States (3, d) with one limb in its other poses: the far bone alone, the near bone, and both leaning the other way.

    A limb of one bone has one (1, d).
    """
    frames = frames_of(jax.tree.map(lambda leaf: leaf[..., None], tree), state[:, None])
    rotation, origin = frames.rotation[..., 0], frames.origin[..., 0]
    ball, eye = origin[limb.ball], cameras.centre[0]
    if limb.hinge is None:
        end = ball + rotation[limb.ball] @ tree.marker_offsets[limb.marker]
        turned = _shortest_turn(end - ball, _other_side(eye, end, ball) - ball) @ rotation[limb.ball]
        return _with_ball(tree, limb, state, rotation, turned)[None]
    hinge = origin[limb.hinge]
    end = hinge + rotation[limb.hinge] @ tree.marker_offsets[limb.marker]
    near, stays = _other_side(eye, hinge, ball), _other_side(eye, end, hinge)
    ends = jnp.concatenate([stays[None], _crossings(eye, end, near, jnp.linalg.norm(end - hinge))])
    hinges = jnp.stack([hinge, near, near])
    return jax.vmap(lambda b, c: _reach(tree, limb, state, rotation, ball, b, c))(hinges, ends)


def mirrored_bend(tree: KinematicTree, limb: Limb, state: Array, frames: Frames, rest: Array, before: Array) -> Array:
    """The state (d,) of the same joints with its hinge on the side of a rest pose (d,), the ball's angles near those before.

    The state's ``frames`` are those of all links, without an axis of states.
    """
    assert limb.hinge is not None
    index, ball = tree.angle_index[limb.hinge][2 - limb.axis], np.array(tree.angle_index[limb.ball])
    rotation, origin = frames.rotation, frames.origin
    end = origin[limb.hinge] + rotation[limb.hinge] @ tree.marker_offsets[limb.marker]
    straight, _ = _straight_angle(tree.offsets[limb.hinge], tree.marker_offsets[limb.marker], np.eye(3)[limb.axis])
    other_side = jnp.sin(state[index] - straight) * jnp.sin(rest[index] - straight) < 0
    near = state.at[ball].set(before)
    bent = near.at[index].set(2 * straight - state[index])
    mirrored = _reach(tree, limb, bent, rotation, origin[limb.ball], origin[limb.hinge], end)
    return jnp.where(other_side, mirrored, _with_ball(tree, limb, near, rotation, rotation[limb.ball]))


def _other_side(eye: Array, point: Array, centre: Array) -> Array:
    """The other point (3,) in a point's line of sight that is as far from a centre."""
    both = _crossings(eye, point, centre, jnp.linalg.norm(point - centre))
    return both[jnp.argmax(jnp.linalg.norm(both - point, axis=1))]


def _crossings(eye: Array, seen: Array, centre: Array, radius: Array) -> Array:
    """Both points (2, 3) of a sphere in a line of sight; where that misses it, twice the point of the sphere nearest to it."""
    sight = (seen - eye) / jnp.linalg.norm(seen - eye)
    along = sight @ (centre - eye)
    foot = eye + along * sight
    half = jnp.sqrt(jnp.maximum(radius**2 - jnp.sum((foot - centre) ** 2), 0.0))
    points = foot + jnp.stack([-half, half])[:, None] * sight
    offset = points - centre
    onto: Array = centre + radius * offset / jnp.linalg.norm(offset, axis=1, keepdims=True)
    return onto


def _reach(tree: KinematicTree, limb: Limb, state: Array, rotation: Array, a: Array, b: Array, c: Array) -> Array:
    """The state (d,) whose limb passes through three points, as to its ball joint, hinge and end."""
    hinge = limb.ball if limb.hinge is None else limb.hinge
    index = tree.angle_index[hinge][2 - limb.axis]
    bone, end = tree.offsets[hinge], tree.marker_offsets[limb.marker]
    bend = _hinge_angle(bone, end, np.eye(3)[limb.axis], jnp.sum((c - a) ** 2), state[index])
    local = bone + _turn(end, np.eye(3)[limb.axis], bend)
    turned, straight = _triad(b - a, c - a)
    still, _ = _triad(bone, local)
    before = rotation[limb.ball]
    shortest = _shortest_turn(before @ bone, b - a) @ before
    return _with_ball(tree, limb, state.at[index].set(bend), rotation, jnp.where(straight, shortest, turned @ still.T))


def _with_ball(tree: KinematicTree, limb: Limb, state: Array, rotation: Array, turned: Array) -> Array:
    """The state (d,) whose ball joint has a rotation (3, 3) in the world, all links (links, 3, 3) above staying."""
    angles = np.array(tree.angle_index[limb.ball])
    return state.at[angles].set(_euler_angles(rotation[tree.parents[limb.ball]].T @ turned, state[angles]))


def _hinge_angle(bone: Array, end: Array, axis: Any, squared: Array, before: Array) -> Array:
    """The angle at which a hinge's end has a squared distance from the joint above, on the side of the angle before."""
    phase, size = _straight_angle(bone, end, axis)
    wanted = 0.5 * (squared - bone @ bone - end @ end) - (bone @ axis) * (end @ axis)
    angle = jnp.arccos(jnp.clip(wanted / size, -1.0, 1.0))
    side = jnp.where(jnp.sin(before - phase) >= 0, 1.0, -1.0)
    return _near(phase + side * angle, before)


def _straight_angle(bone: Array, end: Array, axis: Any) -> tuple[Array, Array]:
    """The angle at which a hinge's end is farthest from the joint above, and how much of the squared distance depends on it."""
    axis = jnp.asarray(axis, bone.dtype)
    flat = end - (end @ axis) * axis
    cosine, sine = bone @ flat, bone @ jnp.cross(axis, end)
    return jnp.arctan2(sine, cosine), jnp.sqrt(cosine**2 + sine**2)


def _turn(vector: Array, axis: Any, angle: Array) -> Array:
    """A vector turned about an axis, by Rodrigues' formula."""
    axis = jnp.asarray(axis, vector.dtype)
    along = (vector @ axis) * axis
    turned: Array = along + jnp.cos(angle) * (vector - along) + jnp.sin(angle) * jnp.cross(axis, vector)
    return turned


def _triad(first: Array, second: Array) -> tuple[Array, Array]:
    """The rotation (3, 3) whose columns begin with the direction of the first of two vectors, and whether they are parallel."""
    x = first / jnp.linalg.norm(first)
    normal = jnp.cross(x, second / jnp.linalg.norm(second))
    size = jnp.linalg.norm(normal)
    z = normal / jnp.maximum(size, 1e-12)
    return jnp.stack([x, jnp.cross(z, x), z], 1), size < _STRAIGHT


def _shortest_turn(start: Array, target: Array) -> Array:
    """The rotation (3, 3) of least angle from one direction to another."""
    u, v = start / jnp.linalg.norm(start), target / jnp.linalg.norm(target)
    w = jnp.cross(u, v)
    cross = jnp.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) * w[2]
    cross = cross + jnp.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]) * w[1]
    cross = cross + jnp.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) * w[0]
    return jnp.eye(3, dtype=u.dtype) + cross + cross @ cross / jnp.maximum(1.0 + u @ v, 1e-6)


def _euler_angles(rotation: Array, before: Array) -> Array:
    """Angles (3,) about Z, Y and X of a rotation: of the two sets that mean it, that nearer to the angles before."""
    y = jnp.arcsin(jnp.clip(-rotation[2, 0], -1.0, 1.0))
    z, x = jnp.arctan2(rotation[1, 0], rotation[0, 0]), jnp.arctan2(rotation[2, 1], rotation[2, 2])
    one = _near(jnp.stack([z, y, x]), before)
    twin = _near(jnp.stack([z + jnp.pi, jnp.pi - y, x + jnp.pi]), before)
    return jnp.where(jnp.sum(jnp.abs(one - before)) <= jnp.sum(jnp.abs(twin - before)), one, twin)


def _near(angles: Array, before: Array) -> Array:
    """Angles within half a turn of those before."""
    return angles - 2 * jnp.pi * jnp.round((angles - before) / (2 * jnp.pi))


@jit_lightly
def bent_as_at_rest(tree: KinematicTree, rest: Array, states: Array, log_weights: Array) -> Array:
    """The same places of all joints, each hinge of a limb bent to its side at rest.

    Args:
        tree: Its limbs (:func:`poseppl.motion.geometry.kinematic_jumps.limbs_of`) are concerned.
        rest: The rest pose (d,), radians; a hinge that is straight there has no side, and is left unchanged.
        states: Draws (T, N, d).
        log_weights: Log-weights of the draws (T, N). Angles of a ball joint are those nearest to the weighted mean of the
        frame before.
    """
    limbs = [limb for limb in limbs_of(tree) if limb.hinge is not None]
    last = jax.tree.map(lambda leaf: leaf[..., None], tree)

    def bent(state: Array, frames: Frames, before: Array) -> Array:
        for limb in limbs:
            state = mirrored_bend(tree, limb, state, frames, rest, before[np.array(tree.angle_index[limb.ball])])
        return state

    def frame(before: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
        drawn, log_weight = now
        moved = jax.vmap(bent, in_axes=(0, -1, None))(drawn, frames_of(last, drawn.T), before)
        return weighted_mean(moved, log_weight), moved

    whole: Array = jax.lax.scan(frame, rest.astype(states.dtype), (states, log_weights))[1]
    return whole
