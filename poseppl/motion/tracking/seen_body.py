r"""A body's walk seen by a detector with autocorrelated errors, as :mod:`poseppl.smoothers.marginal_errors` takes it.

The model is that of ``poseppl_models.bodies.detected_points``, whose state is here x = (pose, velocities, places of the seen
markers beside their joints); its errors are marginalised. Points y of camera c and marker k are linear in small steps of the
marker's place, whose Jacobian by x is (moves, 0, 1): so data weigh places first, a 3 x 3 matrix a marker, and poses by these.

Reduced errors are three numbers a marker: of the errors in all cameras the part that looks like a step of the marker's place.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray
from poseppl_models.bodies.detected_points import FREEDOM

from poseppl.arrays import Booleans, Floats, Integers
from poseppl.gaussians.walk_chains import WalkChains, ar1_chains
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import Cameras, KinematicTree
from poseppl.motion.geometry.recorded_frames import MarkerKinematics, image_points, image_slopes, image_slopes_by_pose
from poseppl.motion.tracking.recorded_velocities import velocity_chains, without_constants
from poseppl.smoothers.marginal_errors import SeenWalk, Unchanging

_RIDGE = 1e-4, 1e-5
"""On what points tell of a place, of its trace, and 1 / mm^2: they tell nothing along the ray of a marker in one camera."""


class SeenBody(NamedTuple):
    """A body and its observations.

    Attributes:
        tree: The body, in float64.
        cameras: C cameras, likewise.
        inputs: Inputs of the programs, without wrapped constants.
        markers: Numbers of the markers that are seen (K,).
        points: (T, C, K, 2) image points of these, 0 where not seen.
        known: Whether they are seen (T, C, K).
        scale: Scale of the independent errors (T, C, K), image units.
        kinematics: Kinematics of the seen markers.
    """

    tree: KinematicTree
    cameras: Cameras
    inputs: BodyInputs
    markers: Integers
    points: Floats
    known: Booleans
    scale: Floats
    kinematics: MarkerKinematics

    @property
    def dimension(self) -> int:
        """d, of a pose."""
        return self.tree.dimension

    def problem(self) -> SeenWalk:
        """The trajectory and what is seen of it; series are those of the markers, each in all cameras."""
        share = float(self.inputs.errors.error_share)
        ratio = np.sqrt(share / (1 - share) * (FREEDOM + 2) / FREEDOM)
        kept = np.asarray(self.inputs.errors.error_kept, np.float64)
        known = _by_series(self.known)
        return SeenWalk(self.chains(), kept, float(ratio), FREEDOM + 2, known, self.residuals, self.view)

    def chains(self) -> WalkChains:
        """How poses, velocities and the places of markers beside their joints walk."""
        own = self.inputs
        shift = ar1_chains(own.errors.shift_kept, float(own.errors.shift_scale), 3 * len(self.markers))
        return velocity_chains(own).beside(shift)

    def states(self, poses: Floats) -> Floats:
        """Trajectory (T, n) of poses (T, d) at rest, with markers in their joints."""
        return np.pad(poses, ((0, 0), (0, self.dimension + 3 * len(self.markers))))

    def shifts(self, x: Floats) -> Floats:
        """Places (T, ..., K, 3) beside the joints, of all markers, in a trajectory (T, ..., n); 0 of those that nobody sees."""
        shift = np.zeros((*x.shape[:-1], len(self.tree.marker_names), 3))
        shift[..., self.markers, :] = x[..., 2 * self.dimension :].reshape(*x.shape[:-1], -1, 3)
        return shift

    def residuals(self, x: Floats) -> Floats:
        """Residuals (M, T, 2) of a trajectory (T, n), in units of the scale."""
        places = self.kinematics.places(x[:, : self.dimension]) + self._own_shifts(x)
        return self._in_units(self.points - image_points(self.cameras, places).swapaxes(0, 1))

    def view(self, x: Floats) -> BodyView:
        """The data linearised about a trajectory (T, n)."""
        places, moves = self.kinematics.places_and_moves(x[:, : self.dimension])
        slopes = image_slopes(self.cameras, places + self._own_shifts(x))[1].swapaxes(0, 1)
        slopes = slopes * (self.known / self.scale)[..., None, None]
        count = len(self.markers)
        by_place = np.ascontiguousarray(slopes.transpose(0, 2, 4, 1, 3)).reshape(len(x), count, 3, -1)
        return BodyView(moves.reshape(len(x), 3 * count, -1), by_place)

    def _own_shifts(self, x: Floats) -> Floats:
        """Places (T, K, 3) beside the joints of the seen markers."""
        return x[:, 2 * self.dimension :].reshape(len(x), -1, 3)

    def unchanging(self, x: Floats) -> Unchanging | None:
        """Errors of lengths and of the cameras' poses, and what is seen of them about a trajectory (T, n); None if exact."""
        errors = self.inputs.errors
        roots = [np.asarray(root, np.float64) for root in (errors.length_root, errors.camera_root)]
        size = sum(map(len, roots))
        if not size:
            return None
        root = np.zeros((size, size))
        root[: len(roots[0]), : len(roots[0])], root[len(roots[0]) :, len(roots[0]) :] = roots
        poses = x[:, : self.dimension]
        places = self.kinematics.places(poses) + self._own_shifts(x)
        by_camera = image_slopes_by_pose(self.cameras, places).swapaxes(0, 1)
        by_place = image_slopes(self.cameras, places)[1].swapaxes(0, 1)
        by_length = by_place @ self._stretches(poses, errors.per_length)
        return Unchanging(root, lambda part: self._seen_of_unchanging(by_length, by_camera, part))

    def _stretches(self, poses: Floats, per_length: Any) -> Floats:
        """Derivatives (T, 1, K, 3, L) of places by lengths: about the root, places are linear in a tree's offsets."""
        at_origin = poses.copy()
        at_origin[:, :3] = 0.0
        found = [np.zeros((len(poses), 1, len(self.markers), 3, 0))]
        if per_length is not None:
            offsets, of_markers = (np.asarray(each, np.float64) for each in (per_length.offsets, per_length.marker_offsets))
            for own, beside in zip(offsets, of_markers[:, self.markers], strict=True):
                found.append(self.kinematics.with_offsets(own, beside).places(at_origin)[:, None, ..., None])
        return np.concatenate(found, -1)

    def _seen_of_unchanging(self, by_length: Floats, by_camera: Floats, part: slice) -> Floats:
        num_lengths = by_length.shape[-1]
        found = []
        for index in range(part.start, part.stop):
            if index < num_lengths:
                change = by_length[..., index]
            else:
                camera, which = divmod(index - num_lengths, 6)
                change = np.zeros(by_length.shape[:-1])
                change[:, camera] = by_camera[:, camera, ..., which]
            found.append(self._in_units(change))
        return np.stack(found)

    def _in_units(self, offset: Floats) -> Floats:
        """Offsets (T, C, K, 2) of the seen markers' points by series, in units of the scale; 0 where not seen."""
        return _by_series(np.where(self.known[..., None], offset / self.scale[..., None], 0.0))


def seen_body(inputs: Any, points: Floats) -> SeenBody:
    """Lay out what is seen.

    Args:
        inputs: Inputs of the programs of ``poseppl_models.bodies.detected_points``, constants wrapped.
        points: (T, C, K, 2) image points, NaN where a marker was not seen.
    """
    own = without_constants(inputs)
    known = np.asarray(np.isfinite(points).all(-1))
    markers = np.flatnonzero(known.any((0, 1)))
    seen = np.where(known[..., None], points, 0.0)[:, :, markers]
    share = float(own.errors.error_share)
    noise = np.broadcast_to(np.asarray(own.noise, np.float64), known.shape)[:, :, markers]
    scale = np.sqrt((1 - share) * FREEDOM / (FREEDOM + 2)) * noise
    tree = _double(own.tree)
    kinematics = MarkerKinematics.of(tree).of_markers(markers)
    return SeenBody(tree, _double(own.cameras), own, markers, seen, known[:, :, markers], scale, kinematics)


class BodyView(NamedTuple):
    """Points linearised about a body's trajectory; methods as :class:`poseppl.smoothers.marginal_errors.View` has them.

    Attributes:
        moves: How the places of K markers change with the pose (T, 3 K, d).
        by_place: How their points do with their places (T, K, 3, 2 C), in units of the scale; 0 where not seen.
    """

    moves: Floats
    by_place: Floats

    def seen(self, x: Floats) -> Floats:
        """J x (N, M, T, 2) of steps (T, N, n)."""
        (frames, columns, _), markers, width = x.shape, self.by_place.shape[1], self.moves.shape[2]
        places = x[..., :width] @ self.moves.transpose(0, 2, 1) + x[..., 2 * width :]
        seen = places.reshape(frames, columns, markers, 3).transpose(0, 2, 1, 3) @ self.by_place
        return seen.reshape(frames, markers, columns, -1, 2).transpose(2, 1, 3, 0, 4).reshape(columns, -1, frames, 2)

    def pulled(self, z: Floats) -> Floats:
        """J^T z (T, N, n)."""
        (columns, _, frames, _), markers, width = z.shape, self.by_place.shape[1], self.moves.shape[2]
        forces = z.reshape(columns, markers, -1, frames, 2).transpose(3, 1, 0, 2, 4).reshape(frames, markers, columns, -1)
        places = (forces @ self.by_place.transpose(0, 1, 3, 2)).transpose(0, 2, 1, 3).reshape(frames, columns, -1)
        return np.concatenate([places @ self.moves, np.zeros((frames, columns, width)), places], -1)

    def reduced(self, weight: Floats, ratio: float) -> tuple[int, Iterator[Floats]]:
        """Three errors a marker, and what each frame's points tell of pose, velocity, places and these."""
        return 3 * self.by_place.shape[1], self._information(*self._of_places(weight, ratio))

    def reduced_noise(self, weight: Floats, ratio: float, rng: np.random.Generator, count: int) -> Floats:
        """Draws (T, N, n + m) with mean 0, whose covariance is that information."""
        precision, root = self._of_places(weight, ratio)
        (frames, markers), width = precision.shape[:2], self.moves.shape[2]
        forces = _symmetric_root(precision) @ rng.standard_normal((frames, markers, 3, count))
        place, error = (each.reshape(frames, 3 * markers, count) for each in (forces, root @ forces))
        pose = np.swapaxes(self.moves, 1, 2) @ place
        found = np.concatenate([pose, np.zeros((frames, width, count)), place, error], 1)
        return np.ascontiguousarray(np.swapaxes(found, 1, 2), np.float32)

    def _of_places(self, weight: Floats, ratio: float) -> tuple[Floats, Floats]:
        """Information of the points on places (T, K, 3, 3), and roots of the reduced errors' covariances there."""
        frames, markers = self.by_place.shape[:2]
        each = weight.reshape(markers, -1, frames, 2, 2).transpose(2, 0, 1, 3, 4)
        slopes = self.by_place.reshape(frames, markers, 3, -1, 2)
        weighed = (slopes.transpose(0, 1, 3, 2, 4) @ each).transpose(0, 1, 3, 2, 4).reshape(self.by_place.shape)
        precision = weighed @ np.swapaxes(self.by_place, -1, -2)
        eye, relative = np.eye(3), _RIDGE[0] * np.trace(precision, axis1=-2, axis2=-1)[..., None, None]
        inverse = np.linalg.inv(precision + (relative + _RIDGE[1]) * eye)
        return precision, ratio * _symmetric_root(inverse @ (weighed @ np.swapaxes(weighed, -1, -2)) @ inverse)

    def _information(self, precision: Floats, root: Floats) -> Iterator[Floats]:
        """Frame by frame, of what points tell of places (T, K, 3, 3), and roots of the reduced errors' covariances there."""
        markers, width = precision.shape[1], self.moves.shape[2]
        size = 3 * markers
        block, each = np.zeros((2 * width + 2 * size,) * 2), np.arange(markers)
        pose, place, error = slice(0, width), slice(2 * width, 2 * width + size), slice(2 * width + size, None)

        def fill(rows: slice, columns: slice, values: Floats) -> None:
            block[rows, columns].reshape(markers, 3, markers, 3)[each, :, each] = values

        for moves, own, scale in zip(self.moves, precision, root, strict=True):
            forces = own @ moves.reshape(markers, 3, width)
            block[pose, pose] = moves.T @ forces.reshape(size, width)
            for rows, values in ((place, forces), (error, scale @ forces)):
                block[rows, pose] = values.reshape(size, width)
                block[pose, rows] = block[rows, pose].T
            across = scale @ own
            fill(place, place, own)
            fill(error, place, across)
            fill(place, error, np.swapaxes(across, -1, -2))
            fill(error, error, across @ scale)
            yield block


def _by_series(values: NDArray[Any]) -> NDArray[Any]:
    """(T, C, K, ...) as (K C, T, ...)."""
    moved = np.moveaxis(values, 0, 2).swapaxes(0, 1)
    return np.ascontiguousarray(moved).reshape(-1, *moved.shape[2:])


def _symmetric_root(matrices: Floats) -> Floats:
    values, vectors = np.linalg.eigh((matrices + np.swapaxes(matrices, -1, -2)) / 2)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]) @ np.swapaxes(vectors, -1, -2))


def _double(tree: Any) -> Any:
    return jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), tree)
