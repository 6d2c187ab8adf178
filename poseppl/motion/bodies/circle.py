r"""A straight walk, laid along a circle on the floor.

Each frame is moved as a whole: it is turned about the vertical and shifted, so that poses relative to the pelvis do not change.
Let d be the direction of the walk, n the direction at a right angle to its left, and p(t) the pelvis on the floor. Its progress
along d, a(t), is smoothed over a second, so that the turn does not shake with the steps:

    q(t)  = mean of p + a(t) d                           the straight line,
    s(t)  = a(t) - a(0),    theta(t) = s(t) / R          arc length, and heading,
    q'(t) = q(0) + R sin theta d + R (1 - cos theta) n   the circle, to the left where R is positive,
    x'(t) = q'(t) + Turn(theta(t)) (x(t) - q(t))         every point x of the frame.

Sway of the pelvis to the side of the line becomes sway to the side of the circle. A foot on the floor turns with the body,
which is not realistic: its sliding speed is the body's turning rate times its distance from q.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.geometry import KinematicTree
from poseppl.motion.io.motion import Motion

MIN_RADIUS = 300.0
"""Smallest radius of a circle, mm."""
MIN_WAY = 500.0
"""Shortest distance that a walk covers in its direction, mm."""
SMOOTHED = 1.0
"""Seconds over which progress is smoothed, about a cycle of a walk."""


class Bend(NamedTuple):
    """How T frames are moved on the floor.

    Attributes:
        angles: Turn about the vertical, radians, counter-clockwise from above (T,).
        before: Points on the straight line (T, 2), mm.
        after: Their positions on the circle (T, 2), mm.
    """

    angles: Floats
    before: Floats
    after: Floats

    def places(self, places: Floats) -> Floats:
        """Move places (T, ..., 3) in mm."""
        shape = (-1,) + (1,) * (places.ndim - 2)
        cosine, sine = (f(self.angles).reshape(shape) for f in (np.cos, np.sin))
        x, y = (places[..., axis] - self.before[:, axis].reshape(shape) for axis in (0, 1))
        moved = [cosine * x - sine * y, sine * x + cosine * y]
        floor = [moved[axis] + self.after[:, axis].reshape(shape) for axis in (0, 1)]
        return np.stack([*floor, places[..., 2]], axis=-1)

    def states(self, tree: KinematicTree, states: Floats) -> Floats:
        """Move states (T, d) of a body.

        Raises:
            InputError: The root's first angle is not about the vertical.
        """
        root, axis = tree.coordinates[3]
        if (root, axis) != (tree.joint_names[0], "Z"):
            problem = f"the body's first angle is {root}.{axis}, and so it cannot be turned"
            raise InputError(problem, field=Argument("turn"), expected="a body whose root turns about Z first")
        moved = states.copy()
        moved[:, :3] = self.places(states[:, :3])
        moved[:, 3] += self.angles
        return moved


def bend_along_circle(pelvis: Floats, rate: float, radius: float) -> Bend:
    """Find how the frames of a straight walk are moved so that it follows a circle.

    Args:
        pelvis: Its places (T, 2) or (T, 3) in mm; NaN where unknown.
        rate: Frames a second.
        radius: Radius of the circle, mm: positive turns left, negative right; infinite goes straight on.

    Returns:
        The moves; the first frame stays where it is.

    Raises:
        InputError: The radius is too small, or the walk goes nowhere.
    """
    if not abs(radius) >= MIN_RADIUS:
        expected = f"at least {MIN_RADIUS:g} mm, or -{MIN_RADIUS:g} and below to turn right"
        raise InputError(f"a radius of {radius:g} mm", field=Argument("turn"), expected=expected)
    path = _complete(np.asarray(pelvis, np.float64)[:, :2])
    centre, ahead = path.mean(0), _direction(path)
    along = _smoothed((path - centre) @ ahead, rate)
    way = along - along[0]
    if not way[-1] >= MIN_WAY:
        expected = f"a walk of at least {MIN_WAY:g} mm in one direction"
        raise InputError(f"the motion goes {max(way[-1], 0.0):.0f} mm ahead", field=Argument("turn"), expected=expected)
    angles, left = way / radius, np.array([-ahead[1], ahead[0]])
    before = centre + along[:, None] * ahead
    # R sin theta and R (1 - cos theta), which hold for an infinite radius, too
    forward = way * np.sinc(angles / np.pi)
    sideways = way * np.sinc(angles / (2 * np.pi)) * np.sin(angles / 2)
    return Bend(angles, before, before[0] + forward[:, None] * ahead + sideways[:, None] * left)


def bend_motion(motion: Motion, pelvis: Floats, radius: float) -> Motion:
    """Lay a recorded walk along a circle.

    Args:
        motion: The walk, Z up.
        pelvis: As :func:`bend_along_circle` takes it.
        radius: Likewise.

    Raises:
        InputError: As :func:`bend_along_circle`.
    """
    return replace(motion, positions=bend_along_circle(pelvis, motion.rate, radius).places(motion.positions))


def _complete(path: Floats) -> Floats:
    """A path (T, 2) whose unknown places lie between those before and after."""
    known, frames = np.isfinite(path).all(-1), np.arange(len(path))
    if not known.any():
        raise InputError("the pelvis is not known in any frame", field=Argument("turn"), expected="a motion that has it")
    return np.stack([np.interp(frames, frames[known], path[known, axis]) for axis in (0, 1)], axis=-1)


def _direction(path: Floats) -> Floats:
    """Unit vector (2,) of the mean velocity, by least squares; x where there is none."""
    times = np.arange(len(path)) - (len(path) - 1) / 2
    velocity = times @ path
    length = np.linalg.norm(velocity)
    return np.asarray(velocity / length if length > 0 else [1.0, 0.0])


def _smoothed(values: Floats, rate: float) -> Floats:
    """Values (T,) by straight lines fitted around each frame."""
    window = min(round(rate * SMOOTHED), len(values))
    window -= 1 - window % 2
    return values if window < 3 else np.asarray(scipy.signal.savgol_filter(values, window, 1))
