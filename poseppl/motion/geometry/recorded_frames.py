"""Kinematics and projections of all frames of a recording at once, with NumPy in float64: nothing is compiled.

Formulas are those of :mod:`poseppl.motion.geometry.kinematics` and :mod:`poseppl.motion.geometry.cameras`. Programs of JAX are
faster where they run many times, but take seconds to compile, which a recording of a hundred frames does not recover.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Booleans, Floats, Integers
from poseppl.motion.geometry.cameras import NEAREST, Cameras, distort
from poseppl.motion.geometry.tree import KinematicTree

_STEP = 1e-6
"""Step of a lens's difference quotients, in the plane at depth 1."""


class _Links(NamedTuple):
    """World frames of L links in T frames: rotations (T, L, 3, 3), origins (T, L, 3) mm, cosines and sines about Z (T, L)."""

    rotation: Floats
    origin: Floats
    cosine: Floats
    sine: Floats


class MarkerKinematics(NamedTuple):
    """The tables that the places of a body's K markers are computed with.

    Attributes:
        offsets: Offsets of the links, mm (L, 3), or in each frame (T, L, 3).
        marker_offsets: Offsets of the markers, likewise (K, 3).
        parents: Parents of the links (L,); the root's is itself.
        levels: Links of one depth, one slice after the other.
        angles: Coordinates of the links' turns about Z, Y and X (L, 3); the last column of a padded pose where there is none.
        marker_link: (K,).
        turns: Link and axis (0 for Z) of each angle (d - 3, 2).
        moved: Which markers an angle moves (K, d - 3).
    """

    offsets: Floats
    marker_offsets: Floats
    parents: Integers
    levels: tuple[slice, ...]
    angles: Integers
    marker_link: Integers
    turns: Integers
    moved: Booleans

    @classmethod
    def of(cls, tree: KinematicTree) -> MarkerKinematics:
        """Those of a body."""
        depths, table, link = np.array(tree.depths), np.array(tree.angle_index), np.array(tree.marker_link)
        ends = np.searchsorted(depths, np.arange(depths[-1] + 2))
        turns = np.empty((tree.dimension - 3, 2), int)
        for which in np.argwhere(table >= 0):
            turns[table[tuple(which)] - 3] = which
        return cls(
            np.asarray(tree.offsets, np.float64),
            np.asarray(tree.marker_offsets, np.float64),
            np.maximum(tree.parents, 0),
            tuple(slice(first, last) for first, last in zip(ends[1:-1], ends[2:], strict=True)),
            np.where(table >= 0, table, tree.dimension),
            link,
            turns,
            tree.ancestors[link][:, turns[:, 0]].astype(bool),
        )

    def of_markers(self, chosen: Integers) -> MarkerKinematics:
        """Those of some of the markers."""
        return self._replace(
            marker_offsets=self.marker_offsets[..., chosen, :], marker_link=self.marker_link[chosen], moved=self.moved[chosen]
        )

    def with_offsets(self, offsets: Floats, marker_offsets: Floats) -> MarkerKinematics:
        """Those of a body of other lengths."""
        return self._replace(offsets=offsets, marker_offsets=marker_offsets)

    def places(self, poses: Floats) -> Floats:
        """Places (T, K, 3), mm, of the markers in poses (T, d)."""
        return self._markers(self._links(poses))

    def places_and_moves(self, poses: Floats) -> tuple[Floats, Floats]:
        """Places (T, K, 3) of the markers in poses (T, d), and their derivatives (T, K, 3, d) by these."""
        links = self._links(poses)
        places, (link, which) = self._markers(links), self.turns.T
        x, y, z = (self._above(links, axis)[:, link] for axis in range(3))
        about_y = links.cosine[:, link, None] * y - links.sine[:, link, None] * x
        axis = np.where(which[:, None] == 0, z, np.where(which[:, None] == 1, about_y, links.rotation[..., 0][:, link]))
        lever = np.moveaxis(places, -1, 0)[..., None] - np.moveaxis(links.origin[:, link], -1, 0)[:, :, None]
        moves = np.zeros((*places.shape, poses.shape[-1]))
        moves[..., np.arange(3), np.arange(3)] = 1.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            turned = axis[:, None, :, j] * lever[k] - axis[:, None, :, k] * lever[j]
            moves[:, :, i, 3:] = np.where(self.moved, turned, 0.0)
        return places, moves

    def _above(self, links: _Links, axis: int) -> Floats:
        """World directions (T, L, 3) of an axis of the links' parents; the root's is the world."""
        found: Floats = links.rotation[..., axis][:, self.parents]
        found[:, 0] = np.eye(3)[axis]
        return found

    def _markers(self, links: _Links) -> Floats:
        turned = links.rotation[:, self.marker_link] @ self.marker_offsets[..., None]
        return np.asarray(links.origin[:, self.marker_link] + turned[..., 0])

    def _links(self, poses: Floats) -> _Links:
        padded = np.concatenate([poses, np.zeros_like(poses[:, :1])], 1)[:, self.angles]
        cosine, sine = np.cos(padded), np.sin(padded)
        rotation = _local_rotations(*(turn[..., axis] for axis in range(3) for turn in (cosine, sine)))
        origin = np.empty(rotation.shape[:3], poses.dtype)
        origin[:, 0] = poses[:, :3]
        for level in self.levels:
            parents = self.parents[level]
            above = rotation[:, parents]
            origin[:, level] = origin[:, parents] + (above @ self.offsets[..., level, :, None])[..., 0]
            rotation[:, level] = above @ rotation[:, level]
        return _Links(rotation, origin, cosine[..., 0], sine[..., 0])


def _local_rotations(cz: Floats, sz: Floats, cy: Floats, sy: Floats, cx: Floats, sx: Floats) -> Floats:
    """R_Z R_Y R_X (T, L, 3, 3), from cosines and sines (T, L)."""
    found = np.empty((*cz.shape, 3, 3), cz.dtype)
    found[..., 0, 0], found[..., 0, 1], found[..., 0, 2] = cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx
    found[..., 1, 0], found[..., 1, 1], found[..., 1, 2] = sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx
    found[..., 2, 0], found[..., 2, 1], found[..., 2, 2] = -sy, cy * sx, cy * cx
    return found


def image_points(cameras: Cameras, places: Floats) -> Floats:
    """Image points (C, ..., 2) of places (..., 3), mm."""
    return np.stack([_image(lens, _in_camera(lens, places)) for lens in _lenses(cameras)])


def image_slopes(cameras: Cameras, places: Floats) -> tuple[Floats, Floats]:
    """Image points (C, ..., 2) of places (..., 3), mm, and their derivatives (C, ..., 2, 3) by these."""
    found = [_slopes(lens, _in_camera(lens, places)) for lens in _lenses(cameras)]
    slopes = [inner @ lens.rotation for (_, inner), lens in zip(found, _lenses(cameras), strict=True)]
    return np.stack([points for points, _ in found]), np.stack(slopes)


def image_slopes_by_pose(cameras: Cameras, places: Floats) -> Floats:
    """Derivatives (C, ..., 2, 6) of image points of places (..., 3) by their camera's errors.

    These are a rotation vector in the camera's axes, radians, and a shift of its centre, mm, as of
    :func:`~poseppl.motion.geometry.cameras.moved_cameras`.
    """
    found = []
    for lens in _lenses(cameras):
        inside = _in_camera(lens, places)
        _, inner = _slopes(lens, inside)
        turned = np.stack([np.cross(axis, inside) for axis in np.eye(3)], -1)
        found.append(np.concatenate([inner @ turned, -(inner @ lens.rotation)], -1))
    return np.stack(found)


def points_of_erring_cameras(cameras: Cameras, places: Floats, errors: Floats | None = None) -> Floats:
    """Image points (C, T, N, K, 2) of places (T, N, K, 3), mm, by cameras with errors (N, 6 C) as above; none if None."""
    found = []
    for c, lens in enumerate(_lenses(cameras)):
        rotation, centre = lens.rotation, np.asarray(lens.centre)
        if errors is not None:
            own = errors[:, 6 * c : 6 * c + 6]
            rotation = Rotation.from_rotvec(own[:, :3]).as_matrix() @ rotation
            centre = (centre + own[:, 3:])[:, None]
        inside = (places - centre.astype(places.dtype)) @ np.swapaxes(rotation, -1, -2).astype(places.dtype)
        found.append(_image(lens, inside))
    return np.stack(found)


def depths(cameras: Cameras, places: Floats) -> Floats:
    """Distances (C, ...) of places (..., 3) along the cameras' axes, mm, positive in front."""
    return np.stack([_in_camera(lens, places)[..., 2] for lens in _lenses(cameras)])


def _lenses(cameras: Cameras) -> list[Cameras]:
    """The cameras one by one, in float64."""
    double: Any = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), cameras)
    table = None if double.distortion is None else list(double.distortion)
    rows = zip(
        double.rotation, double.centre, double.focal, double.principal, table or [None] * len(double.centre), strict=True
    )
    return [Cameras(*row) for row in rows]


def _in_camera(lens: Cameras, places: Floats) -> Floats:
    return np.asarray((places - lens.centre) @ np.transpose(lens.rotation))


def _image(lens: Cameras, inside: Floats) -> Floats:
    plane = inside[..., :2] / np.maximum(inside[..., 2:], NEAREST)
    return np.asarray(lens.focal * _bent(lens, plane) + lens.principal)


def _bent(lens: Cameras, plane: Floats) -> Floats:
    if lens.distortion is None:
        return plane
    return np.stack(distort(lens.distortion, plane[..., 0], plane[..., 1], np), -1)


def _slopes(lens: Cameras, inside: Floats) -> tuple[Floats, Floats]:
    """Image points (..., 2) of places (..., 3) in a camera's own axes, and their derivatives (..., 2, 3)."""
    inverse = 1 / np.maximum(inside[..., 2:], NEAREST)
    plane = inside[..., :2] * inverse
    by_place = np.zeros((*plane.shape, 3))
    by_place[..., 0, 0] = by_place[..., 1, 1] = inverse[..., 0]
    by_place[..., 2] = np.where(inside[..., 2:] > NEAREST, -plane * inverse, 0.0)
    if lens.distortion is not None:
        steps = _STEP * np.eye(2)
        bend = [(_bent(lens, plane + step) - _bent(lens, plane - step)) / (2 * _STEP) for step in steps]
        by_place = np.stack(bend, -1) @ by_place
    return np.asarray(lens.focal * _bent(lens, plane) + lens.principal), np.asarray(lens.focal[:, None] * by_place)
