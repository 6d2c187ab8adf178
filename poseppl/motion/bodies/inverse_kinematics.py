"""Inverse kinematics: the states of a body whose markers lie closest to recorded ones.

For every frame x a nonlinear least-squares problem, by Levenberg and Marquardt's method (MINPACK), in float64:

    minimise  sum over seen markers |p_m(x) - y_m|^2 + w^2 |angles of x - those before|^2 + v^2 |angles of x - those at rest|^2

The last two terms hold what the markers do not show: the twist of a thigh about its own axis while the knee is straight, a
joint whose markers are missing. They are weak, w = 5 and v = 2 mm a radian: an angle whose markers have a lever of 100 mm lags
them by 1/400 of its change since the frame before, and is drawn to rest by 1/2500. The root's own angles have no rest, and a
hundredth of w: where a turn of the whole body and opposite turns of its parts look the same (a spine is a line), it is the body
that turns.

Rest decides between mirror twins, too: a thigh turned by pi about its own axis, with the knee bent the wrong way, puts every
marker at the same place. So let ``start`` have its knees and elbows bent a little. The first frame has no frame before it and
is sought from several headings; where a marker leaps, as after the calibration pose that many recordings begin with, a frame
is sought from rest as well as from the frame before.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from poseppl.arrays import Booleans, Floats
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.geometry.recorded_frames import MarkerKinematics

ANGLE_PULL = 5.0
"""Weight (mm a radian) that holds angles to the frame before."""
REST_PULL = 2.0
"""Weight (mm a radian) that draws angles other than the root's to rest."""
ROOT_PULL = 0.05
"""Weight (mm a radian) that holds the root's angles to the frame before."""
POSITION_PULL = 0.01
"""Weight (mm a mm) that holds the root's position to the frame before; it counts when no marker is seen."""
LEAP = 250.0
"""A marker that moves as far (mm) between two frames makes the second one be sought from rest as well."""
_MARGIN = 5.0
"""Cost (mm^2) by which a frame sought from rest must be better; a thigh's mirror twin costs 20 mm^2."""
NUM_HEADINGS = 8
"""Headings from which the first frame is sought."""


def fit_states(tree: KinematicTree, markers: ArrayLike, start: ArrayLike | None = None) -> tuple[Floats, Floats]:
    """Find the states whose markers lie closest to the given ones, continuous over time.

    Args:
        tree: The body.
        markers: Positions (T, K, 3) in mm of the tree's markers, in its order; NaN where a marker is missing. A frame without
            any is held, apart from the pull to rest.
        start: The pose at rest (d,), wherever it stands and heads; all angles zero by default.

    Returns:
        The states (T, d), angles without jumps of 2 pi, and the distances (T, K) in mm between the markers of the states and
        the given ones, NaN where missing.

    Raises:
        ValueError: ``markers`` or ``start`` has a wrong shape, or no frame has a marker.
    """
    target = np.asarray(markers, np.float64)
    count = len(tree.marker_names)
    if target.ndim != 3 or target.shape[1:] != (count, 3) or len(target) == 0:
        raise ValueError(f"markers have shape {target.shape}, expected (T, {count}, 3)")
    rest = np.zeros(tree.dimension) if start is None else np.asarray(start, np.float64)
    if rest.shape != (tree.dimension,):
        raise ValueError(f"start has shape {rest.shape}, expected ({tree.dimension},)")
    seen = np.isfinite(target).all(-1).sum(-1)
    if not seen.any():
        raise ValueError("no frame has a marker")
    solve = _solver(tree)
    first = int(np.argmax(seen == seen.max()))
    states = np.empty((len(target), tree.dimension))
    with threadpool_limits(limits=1, user_api="blas"):  # threads of small matrices wait for each other, and spin
        states[first] = _first_state(tree, solve, target[first], rest)
        for frames, step in ((range(first + 1, len(target)), 1), (range(first - 1, -1, -1), -1)):
            for frame in frames:
                previous = states[frame - step]
                states[frame] = _next_state(tree, solve, target[frame], previous, rest)
                if _leaps(target[frame], target[frame - step]):
                    cut = _after_leap(tree, solve, target[frame], states[frame], rest)
                    states[frame] = _nearest_twin(tree, cut, previous)
    return states, np.linalg.norm(MarkerKinematics.of(tree).places(states) - target, axis=-1)


Solver = Callable[[Floats, Floats, Floats, Floats], tuple[Floats, float]]


def _solver(tree: KinematicTree) -> Solver:
    """The least-squares problem of one frame: (target, guess, anchor, pull) to (state, cost)."""
    kinematics, scale = MarkerKinematics.of(tree), _scale(tree)

    def solve(target: Floats, guess: Floats, anchor: Floats, pull: Floats) -> tuple[Floats, float]:
        seen = np.isfinite(target).all(-1)
        own, places = kinematics.of_markers(np.flatnonzero(seen)), target[seen]

        def offsets(x: Floats) -> Floats:
            return np.concatenate([(own.places(x[None])[0] - places).ravel(), pull * (x - anchor)])

        def slopes(x: Floats) -> Floats:
            return np.concatenate([own.places_and_moves(x[None])[1].reshape(-1, x.size), np.diag(pull)])

        found = scipy.optimize.least_squares(
            offsets, guess, jac=slopes, method="lm", x_scale=scale, ftol=1e-8, xtol=1e-8, gtol=1e-10, max_nfev=200
        )
        return found.x, float(found.cost)

    return solve


def _first_state(tree: KinematicTree, solve: Solver, target: Floats, rest: Floats) -> Floats:
    """Seek the first frame from several headings; the best of what is found."""
    heading = [i for i, coordinate in enumerate(tree.coordinates) if coordinate == (tree.coordinates[0][0], "Z")]
    turns = 2 * np.pi * np.arange(NUM_HEADINGS) / NUM_HEADINGS if heading else [0.0]
    pull = np.where(_of_root(tree), 1e-6, REST_PULL)
    seen = np.isfinite(target).all(-1)
    kinematics, candidates = MarkerKinematics.of(tree), []
    for turn in turns:
        guess = rest.copy()
        guess[heading] += turn
        guess[:3] += (target[seen] - kinematics.places(guess[None])[0, seen]).mean(0)
        candidates.append(solve(target, guess, guess, pull))
    best = min(candidates, key=lambda candidate: candidate[1])[0]
    return _near(best, np.where(_of_root(tree), 0.0, rest))


def _next_state(tree: KinematicTree, solve: Solver, target: Floats, previous: Floats, rest: Floats) -> Floats:
    """Solve a frame from the one before it; two pulls on a coordinate make one, towards their weighted mean."""
    before = np.where(_of_root(tree), ROOT_PULL, ANGLE_PULL) ** 2
    before[:3] = POSITION_PULL**2
    home = np.where(_of_root(tree), 0.0, REST_PULL) ** 2
    anchor = (before * previous + home * rest) / (before + home)
    return _near(solve(target, previous, anchor, np.sqrt(before + home))[0], previous)


def _leaps(target: Floats, before: Floats) -> bool:
    distance = np.linalg.norm(target - before, axis=-1)
    return bool(np.any(distance[np.isfinite(distance)] > LEAP))


def _after_leap(tree: KinematicTree, solve: Solver, target: Floats, found: Floats, rest: Floats) -> Floats:
    """Choose between a solution and one sought from rest; what lets go of the frame before must be better without it."""
    anchor = np.where(_of_root(tree), found, rest)
    pull = np.where(_of_root(tree), 1e-6, REST_PULL)
    (_, kept), (fresh, cost) = (solve(target, guess, anchor, pull) for guess in (found, anchor))
    return fresh if cost < kept - _MARGIN else found


def _near(state: Floats, other: Floats) -> Floats:
    """Take whole turns from the angles until they are within pi of another state's."""
    near = state.copy()
    near[3:] -= 2 * np.pi * np.round((state[3:] - other[3:]) / (2 * np.pi))
    return near


def _nearest_twin(tree: KinematicTree, state: Floats, other: Floats) -> Floats:
    """Choose, among angles of the same rotations, those nearest to another state's.

    Turns z, y, x about the axes of a joint are the same rotation as z + pi, pi - y, x + pi.
    """
    near = _near(state, other)
    axes = tree.coordinates
    for first in range(3, len(axes) - 2):
        joint = slice(first, first + 3)
        if axes[joint] == tuple((axes[first][0], axis) for axis in "ZYX"):
            twin = near.copy()
            twin[joint] = np.array([1.0, -1.0, 1.0]) * near[joint] + np.pi
            near = min(near, _near(twin, other), key=lambda each: float(np.abs(each - other)[joint].sum()))
    return near


def _of_root(tree: KinematicTree) -> Booleans:
    return np.array([joint == tree.coordinates[0][0] for joint, _ in tree.coordinates])


def _scale(tree: KinematicTree) -> Floats:
    """Typical changes: 100 mm, 0.3 rad."""
    return np.where(np.arange(tree.dimension) < 3, 100.0, 0.3)
