"""Start of tracking: the mean of the first state.

If the true state is known, it is the start, with the standard deviation of one step of the random walk. Otherwise the start is
the pose that explains the best-seen frame, by nonlinear least squares on the image points,

    minimise  sum over seen points |projected - observed|^2 / noise^2 + |angles - rest|^2 / 0.5^2,

from several headings, because a body looks alike from the front and from the back in one camera. The initial position comes
from the rays of several cameras, or from the apparent size in one.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from poseppl.arrays import Booleans, Floats
from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.recorded_frames import MarkerKinematics, image_points, image_slopes

NUM_HEADINGS = 8
START_ANGLE = 0.3
"""Standard deviation (radians) of the angles of a start that was sought."""
START_POSITION = 150.0
"""Standard deviation (mm) of its position."""
_REST_SPREAD = 0.5
_MIN_MARKERS = 4


def scales(body: Body, position: float, angle: float) -> Floats:
    """Standard deviations (d,): one for the root's translations (mm), one for all angles (radians)."""
    return np.array([position if axis in ("tx", "ty", "tz") else angle for _, axis in body.tree.coordinates])


def start_scales(body: Body) -> Floats:
    """Standard deviations (d,) of a first state that was sought."""
    return scales(body, START_POSITION, START_ANGLE)


def seek_start(body: Body, cameras: Cameras, points: Floats, noise: Floats) -> Floats:
    """Find a start in the image points.

    Args:
        body: The body.
        cameras: C cameras.
        points: (T, C, K, 2), NaN where missing; the earliest of the best-seen frames is taken.
        noise: (C, K) or (T, C, K), in image units.

    Returns:
        The state (d,), known within :func:`start_scales`.

    Raises:
        InputError: No frame shows enough markers.
    """
    seen = np.isfinite(points).all(-1).sum((1, 2))
    enough = seen >= max(_MIN_MARKERS, 0.8 * seen.max())
    if not enough.any():
        problem = f"no frame shows more than {seen.max()} markers, too few to start from"
        raise InputError(problem, expected=f"a frame with {_MIN_MARKERS} or more")
    frame = int(np.argmax(enough))
    spread = noise if noise.ndim == 2 else noise[frame]
    return _best_pose(body, cameras, points[frame], spread)


class PoseSearch(NamedTuple):
    """Common parts of searches for a body's pose.

    Attributes:
        rest: The rest pose (d,).
        headings: Indices of the root's turn about the vertical, if it has one.
        free: (d,) whether a coordinate is held near the rest pose: all but the root's.
        x_scale: (d,) mm and radians in which steps are measured.
    """

    rest: Floats
    headings: list[int]
    free: Booleans
    x_scale: Floats

    @classmethod
    def of(cls, body: Body) -> PoseSearch:
        """The search for a pose of a body."""
        root, coordinates = body.tree.coordinates[0][0], body.tree.coordinates
        headings = [i for i, coordinate in enumerate(coordinates) if coordinate == (root, "Z")]
        free = np.array([joint != root for joint, _ in coordinates])
        return cls(np.asarray(body.rest, np.float64), headings, free, scales(body, 100.0, 0.3))

    def guesses(self) -> Iterator[Floats]:
        """Rest poses that face all around."""
        for turn in 2 * np.pi * np.arange(NUM_HEADINGS if self.headings else 1) / NUM_HEADINGS:
            guess = self.rest.copy()
            guess[self.headings] += turn
            yield guess

    def unwound(self, state: Floats) -> Floats:
        """The same pose with angles within half a turn of those at rest."""
        turns = np.round((state - self.rest) / (2 * np.pi))
        turns[:3] = 0
        return state - 2 * np.pi * turns


def _best_pose(body: Body, cameras: Cameras, points: Floats, noise: Floats) -> Floats:
    search = PoseSearch.of(body)
    seen, kinematics = np.isfinite(points), MarkerKinematics.of(body.tree)
    shown = np.asarray(seen.all(axis=2).any(axis=0))
    shape, weights = np.where(seen, points, 0.0), seen / noise[..., None]
    held = np.where(search.free, 1 / _REST_SPREAD, 0.0)

    def offsets(x: Floats) -> Floats:
        seen_there = image_points(cameras, kinematics.places(x[None])[0])
        return np.concatenate([((seen_there - shape) * weights).ravel(), held * (x - search.rest)])

    def slopes(x: Floats) -> Floats:
        places, moves = kinematics.places_and_moves(x[None])
        by_pose = (image_slopes(cameras, places[0])[1] * weights[..., None]) @ moves[0]
        return np.concatenate([by_pose.reshape(-1, x.size), np.diag(held)])

    solve = partial(
        scipy.optimize.least_squares,
        offsets,
        jac=slopes,
        x_scale=search.x_scale,
        method="trf",
        ftol=1e-4,
        xtol=1e-5,
        gtol=None,
        max_nfev=60,
    )
    found = []
    for guess in search.guesses():
        guess[:3] = guess[:3] + place_of_points(body, cameras, points, guess) - kinematics.places(guess[None])[0, shown].mean(0)
        solution = solve(x0=guess)
        found.append((float(solution.cost), solution.x))
    return search.unwound(np.asarray(min(found, key=lambda candidate: candidate[0])[1], np.float64))


def place_of_points(body: Body, cameras: Cameras, points: Floats, guess: Floats) -> Floats:
    """Middle of the seen markers: the nearest point to the rays of all cameras that see some, else by size."""
    places, normals, posed = [], [], MarkerKinematics.of(body.tree).places(guess[None])[0]
    for camera in range(len(points)):
        seen = np.isfinite(points[camera]).all(-1)
        if not seen.any():
            continue
        focal, principal = (np.asarray(field[camera], np.float64) for field in (cameras.focal, cameras.principal))
        image = (points[camera, seen] - principal) / focal
        ray = np.append(image.mean(0), 1.0)
        rotation, centre = (np.asarray(field[camera], np.float64) for field in (cameras.rotation, cameras.centre))
        markers = posed[seen]
        across = ((markers - markers.mean(0)) @ rotation.T)[:, :2]
        size = np.sqrt(np.square(image - image.mean(0)).sum())
        depth = np.sqrt(np.square(across).sum()) / max(float(size), 1e-9)
        direction = rotation.T @ ray
        places.append(centre + direction * np.clip(depth, 100.0, 1e5))
        direction = direction / np.linalg.norm(direction)
        normals.append((np.eye(3) - np.outer(direction, direction), centre))
    if len(places) == 1:
        return np.asarray(places[0], np.float64)
    # a little of the sizes' answer, for cameras that stand together
    middle = np.mean(places, axis=0)
    matrix = sum(normal for normal, _ in normals) + 1e-3 * np.eye(3)
    return np.asarray(np.linalg.solve(matrix, sum(n @ c for n, c in normals) + 1e-3 * middle), np.float64)
