"""Forward kinematics with its gradient by the geometric Jacobian.

:func:`marker_positions` gives the markers of one state; under ``jax.vmap`` it runs with the batch in the last axis. Its
gradient comes from the wrench that acts on each subtree, not from differentiation through the chain of rotations. A rotation
about the world axis a through the pivot o moves a marker p by ``a x (p - o)``, so that with forces f on the markers

    d L / d angle = a . (sum of p x f - o x sum of f),

summed over the markers that the joint moves. Links are evaluated a depth at a time, all links of one depth together, so that a
body needs a dozen array operations and not hundreds of scalar ones.

:func:`unrolled_forward_kinematics` is the same recursion written scalar by scalar, for evaluations without a gradient. The
compiler then fuses a whole likelihood into one loop over particles, and writes nothing to memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.motion.geometry.batch_last import batch_last
from poseppl.motion.geometry.tree import KinematicTree

Vector = tuple[Any, Any, Any]


class Frames(NamedTuple):
    """World frames of every link, batch last: what the gradient needs of the forward pass.

    ``rotation`` (links, 3, 3, N), ``origin`` (links, 3, N) mm, ``cosine`` and ``sine`` (links, N) of the angles about Z.
    """

    rotation: Array
    origin: Array
    cosine: Array
    sine: Array


@jax.custom_vjp
def marker_positions(tree: KinematicTree, state: Array) -> Array:
    """World positions of the markers.

    Args:
        tree: The body.
        state: Shape (d,): root position in mm, angles in radians.

    Returns:
        Shape (markers, 3), mm.
    """
    positions: Array = _positions(tree, state)
    return positions


def _positions_last(tree: KinematicTree, state: Array) -> Array:
    return markers_of(tree, frames_of(tree, state))


def _pull_back_last(tree: KinematicTree, state: Array, forces: Array) -> tuple[KinematicTree, Array]:
    frames = frames_of(tree, state)
    return pull_back(tree, frames, markers_of(tree, frames), forces)


_positions = batch_last(_positions_last)
_pull_back = batch_last(_pull_back_last)


def _forward(tree: KinematicTree, state: Array) -> tuple[Array, tuple[KinematicTree, Array]]:
    return _positions(tree, state), (tree, state)


def _backward(residuals: tuple[KinematicTree, Array], forces: Array) -> tuple[KinematicTree, Array]:
    gradients: tuple[KinematicTree, Array] = _pull_back(*residuals, forces)
    return gradients


marker_positions.defvjp(_forward, _backward)


def frames_of(tree: KinematicTree, state: Array) -> Frames:
    """World frames of all links: state (d, N) gives :class:`Frames`."""
    count = state.shape[-1]
    unit = jnp.ones((1, count), state.dtype)
    index = np.where(np.array(tree.angle_index) >= 0, np.array(tree.angle_index) - 3, tree.dimension - 3)
    cosines = jnp.concatenate([jnp.cos(state[3:]), unit])
    sines = jnp.concatenate([jnp.sin(state[3:]), 0 * unit])
    local = _local_rotations(*(table[index[:, axis]] for axis in range(3) for table in (cosines, sines)))
    rotation = local[:1]
    for level in range(1, max(tree.depths) + 1):
        links = [link for link, depth in enumerate(tree.depths) if depth == level]
        above = rotation[np.array([tree.parents[link] for link in links])]
        rotation = jnp.concatenate([rotation, _product(above, local[links[0] : links[-1] + 1])])
    parents = np.maximum(tree.parents, 0)  # the root has no offset, so its own parent does not matter
    steps = _apply(rotation[parents], tree.offsets)
    # the path to each link as one product with a 0/1 matrix; full precision, or float32 loses half its digits on accelerators
    paths = jnp.asarray(tree.ancestors, state.dtype)
    origin = jnp.tensordot(paths, steps, 1, precision="highest") + state[:3]
    return Frames(rotation, origin, cosines[index[:, 0]], sines[index[:, 0]])


def markers_of(tree: KinematicTree, frames: Frames) -> Array:
    """World positions (markers, 3, N) of the markers in the given frames."""
    link = np.array(tree.marker_link)
    return frames.origin[link] + _apply(frames.rotation[link], tree.marker_offsets)


def pull_back(tree: KinematicTree, frames: Frames, positions: Array, forces: Array) -> tuple[KinematicTree, Array]:
    """Gradient with respect to the tree's offsets and the state, given the gradient with respect to the markers.

    Args:
        tree: The body.
        frames: From :func:`frames_of`.
        positions: Marker positions (markers, 3, N).
        forces: Gradient of some function with respect to them (markers, 3, N).

    Returns:
        A tree whose arrays are gradients, and the gradient of the state (d, N).
    """
    link = np.array(tree.marker_link)
    place, _ = _coordinate_order(tree)
    wrenches = jnp.concatenate([forces, jnp.stack(_cross(positions, forces), 1)], 1)
    below = jnp.asarray(tree.ancestors[link].T, forces.dtype)
    total = jnp.tensordot(below, wrenches, 1, precision="highest")  # summed over each link's subtree
    force, moment = total[:, :3], total[:, 3:]
    lever = jnp.stack([a - b for a, b in zip(_split(moment), _cross(frames.origin, force), strict=True)], 1)
    turns = [jnp.sum(axis * lever, 1) for axis in _axes(tree, frames)]  # stacking the axes first would cost half the speed
    gradient = jnp.concatenate([force[0], *turns])[place]
    above = frames.rotation[np.maximum(tree.parents, 0)]
    offsets = jnp.sum(above * force[:, :, None], 1).at[0].set(0.0)
    marker_offsets = jnp.sum(frames.rotation[link] * forces[:, :, None], 1)
    return tree.with_offsets(offsets, marker_offsets), gradient


def jacobian_of(tree: KinematicTree, frames: Frames, positions: Array) -> Array:
    """How markers move with the state: (markers, 3, d, N), an angle's column being ``a x (p - o)`` for the markers it moves.

    Args:
        tree: The body.
        frames: From :func:`frames_of`.
        positions: Marker positions (markers, 3, N).
    """
    place, link = _coordinate_order(tree)
    axis = jnp.concatenate(_axes(tree, frames))[place[3:] - 3]
    lever = positions[:, None] - frames.origin[link]  # (markers, angles, 3, N)
    turned = jnp.stack(_cross(axis, jnp.moveaxis(lever, 2, 1)), 1)
    moved = tree.ancestors[np.array(tree.marker_link)][:, link].astype(bool)
    turns = jnp.where(moved[:, None, :, None], turned, 0.0)
    shift = jnp.broadcast_to(jnp.eye(3, dtype=positions.dtype)[:, :, None], (len(moved), 3, 3, positions.shape[-1]))
    return jnp.concatenate([shift, turns], 2)


def derivatives_of_wrenches(tree: KinematicTree, frames: Frames, force: Array, moment: Array, link: Array) -> Array:
    """Derivatives (..., d, N) by the state of functions of which each depends on one link, by the geometric Jacobian.

    Args:
        tree: The body.
        frames: From :func:`frames_of`.
        force: Gradients by a shift of the link (..., 3, N).
        moment: Gradients by a turn of the link about the world's origin (..., 3, N).
        link: The links (..., N).
    """
    place, turning = _coordinate_order(tree)
    axis = jnp.concatenate(_axes(tree, frames))[place[3:] - 3]
    swing = jnp.stack(_cross(frames.origin[turning], axis), 1)  # what a turn about the axis shifts the world's origin by
    turns = sum(axis[:, i] * moment[..., None, i, :] + swing[:, i] * force[..., None, i, :] for i in range(3))
    moved = jnp.moveaxis(jnp.asarray(tree.ancestors[:, turning], bool)[link], -1, -2)
    return jnp.concatenate([force, jnp.where(moved, turns, 0.0)], -2)


def _coordinate_order(tree: KinematicTree) -> tuple[np.ndarray, np.ndarray]:
    """For each coordinate its place in the list of the root's three, all turns about Z, Y and X; for each angle its link."""
    table = np.array(tree.angle_index).T
    place = np.arange(tree.dimension)
    place[table[table >= 0]] = 3 + np.flatnonzero(table >= 0)
    return place, (place[3:] - 3) % table.shape[1]


def _axes(tree: KinematicTree, frames: Frames) -> Vector:
    """World axes (links, 3, N) of the rotations about Z, Y and X."""
    world = jnp.broadcast_to(jnp.eye(3, dtype=frames.origin.dtype)[None, :, :, None], (1, *frames.rotation.shape[1:]))
    above = jnp.concatenate([world, frames.rotation[np.array(tree.parents[1:], int)]])
    about_y = frames.cosine[:, None] * above[:, :, 1] - frames.sine[:, None] * above[:, :, 0]
    return above[:, :, 2], about_y, frames.rotation[:, :, 0]


def _local_rotations(cz: Any, sz: Any, cy: Any, sy: Any, cx: Any, sx: Any) -> Array:
    """R_Z R_Y R_X of every link (links, 3, 3, N), from cosines and sines (links, N)."""
    first = jnp.stack([cz * cy, sz * cy, -sy], 1)
    second = jnp.stack([cz * sy * sx - sz * cx, sz * sy * sx + cz * cx, cy * sx], 1)
    third = jnp.stack([cz * sy * cx + sz * sx, sz * sy * cx - cz * sx, cy * cx], 1)
    return jnp.stack([first, second, third], 2)


def _product(a: Array, b: Array) -> Array:
    return a[:, :, 0, None] * b[:, 0, None] + a[:, :, 1, None] * b[:, 1, None] + a[:, :, 2, None] * b[:, 2, None]


def _apply(rotation: Array, vector: Array) -> Array:
    return jnp.sum(rotation * vector[:, None], 2)


def _split(vector: Array) -> Vector:
    return vector[:, 0], vector[:, 1], vector[:, 2]


def _cross(a: Array, b: Array) -> Vector:
    (ax, ay, az), (bx, by, bz) = _split(a), _split(b)
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def unrolled_forward_kinematics(tree: KinematicTree, state: Sequence[Any]) -> list[Vector]:
    """Marker positions scalar by scalar.

    Args:
        tree: The body; ``offsets`` may have any trailing batch shape.
        state: d arrays of one shape: the coordinates.

    Returns:
        For each marker its three world coordinates (mm), each of the shape of a coordinate.
    """
    frames: list[tuple[Vector, tuple[Vector, Vector, Vector]]] = []
    for link, parent in enumerate(tree.parents):
        if parent < 0:
            origin, columns = (state[0], state[1], state[2]), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        else:
            origin, columns = frames[parent]
            origin = _offset(origin, columns, tree.offsets[link], tree.offset_pattern[link])
        for axis, index in zip((2, 1, 0), tree.angle_index[link], strict=True):
            if index >= 0:
                columns = _turn(columns, axis, jnp.cos(state[index]), jnp.sin(state[index]))
        frames.append((origin, columns))
    return [
        _offset(*frames[link], tree.marker_offsets[marker], tree.marker_pattern[marker])
        for marker, link in enumerate(tree.marker_link)
    ]


def _turn(columns: Any, axis: int, cosine: Any, sine: Any) -> Any:
    """Right-multiply by a rotation about one axis: two columns mix, the third stays."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned = list(columns)
    turned[first] = tuple(cosine * a + sine * b for a, b in zip(columns[first], columns[second], strict=True))
    turned[second] = tuple(cosine * b - sine * a for a, b in zip(columns[first], columns[second], strict=True))
    return tuple(turned)


def _offset(origin: Any, columns: Any, offset: Any, pattern: tuple[bool, bool, bool]) -> Any:
    """``origin + R offset``, without the products that the pattern knows to be zero."""
    for axis in range(3):
        if pattern[axis]:
            origin = tuple(o + c * offset[axis] for o, c in zip(origin, columns[axis], strict=True))
    return origin
