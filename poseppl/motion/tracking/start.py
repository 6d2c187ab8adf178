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

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax import Array

from poseppl.arrays import Booleans, Floats
from poseppl.errors import InputError
from poseppl.motion.bodies.body import Body
from poseppl.motion.geometry import Cameras, KinematicTree, marker_positions, project
from poseppl.stored_programs import stored_jit

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


def _offsets(x: Array, tree: KinematicTree, cameras: Cameras, points: Array, weights: Array, rest: Array, free: Array) -> Array:
    """Residuals of points, and of the pose beside the rest pose."""
    offset = (project(cameras, marker_positions(tree, x)) - points) * weights
    return jnp.concatenate([offset.ravel(), jnp.where(free, (x - rest) / _REST_SPREAD, 0.0)])


_residuals, _derivatives = stored_jit(_offsets), stored_jit(jax.jacrev(_offsets))


def _best_pose(body: Body, cameras: Cameras, points: Floats, noise: Floats) -> Floats:
    search = PoseSearch.of(body)
    seen = np.isfinite(points)
    shown = np.asarray(seen.all(axis=2).any(axis=0))
    shape = np.where(seen, points, 0.0)

    weights = seen / noise[..., None]
    given = body.tree, cameras, shape, weights, search.rest, search.free
    solve = partial(
        scipy.optimize.least_squares,
        lambda x: np.asarray(_residuals(x, *given), np.float64),
        jac=lambda x: np.asarray(_derivatives(x, *given), np.float64),
        x_scale=search.x_scale,
        method="trf",
        ftol=1e-4,
        xtol=1e-5,
        gtol=None,
        max_nfev=60,
    )
    found = []
    for guess in search.guesses():
        guess[:3] = guess[:3] + place_of_points(body, cameras, points, guess) - _centre(body, guess, shown)
        solution = solve(x0=guess)
        found.append((float(solution.cost), solution.x))
    return search.unwound(np.asarray(min(found, key=lambda candidate: candidate[0])[1], np.float64))


def _centre(body: Body, state: Floats, seen: Booleans) -> Floats:
    """Mean place (3,) of the seen markers of a state."""
    places = np.asarray(marker_positions(body.tree, jnp.asarray(state)), np.float64)
    return np.asarray(places[seen].mean(0))


def place_of_points(body: Body, cameras: Cameras, points: Floats, guess: Floats) -> Floats:
    """Middle of the seen markers: the nearest point to the rays of all cameras that see some, else by size."""
    places, normals = [], []
    for camera in range(len(points)):
        seen = np.isfinite(points[camera]).all(-1)
        if not seen.any():
            continue
        focal, principal = (np.asarray(field[camera], np.float64) for field in (cameras.focal, cameras.principal))
        image = (points[camera, seen] - principal) / focal
        ray = np.append(image.mean(0), 1.0)
        rotation, centre = (np.asarray(field[camera], np.float64) for field in (cameras.rotation, cameras.centre))
        markers = np.asarray(marker_positions(body.tree, jnp.asarray(guess)), np.float64)[seen]
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
