"""A recorded motion: points in space over time, whichever format it came from; and the same at another rate.

Every reader yields millimetres and Z up: a Y-up recording's (x, y, z) becomes (x, -z, y).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import InputError, Location, brief
from poseppl.files.frame_range import FrameRange
from poseppl.motion.io.text_parsing import some


@dataclass(frozen=True, eq=False)
class Motion:
    """A recorded motion of T frames and J points.

    Attributes:
        names: J names, of joints or markers.
        positions: (T, J, 3) mm, Z up; NaN where a marker was not seen.
        parents: For each joint the index of its parent, -1 for a root; empty for a cloud of markers.
        rate: Frames a second.
        source: Source.
        notes: Notes of the reader, a sentence each.
    """

    names: tuple[str, ...]
    positions: Floats
    parents: tuple[int, ...]
    rate: float
    source: str
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.positions.ndim != 3 or self.positions.shape[1:] != (len(self.names), 3):
            raise ValueError(f"positions have shape {self.positions.shape}, expected (T, {len(self.names)}, 3)")
        if self.parents and len(self.parents) != len(self.names):
            raise ValueError(f"{len(self.parents)} parents for {len(self.names)} names")

    def index(self, name: str) -> int:
        """Index of a point by its name; raises InputError with the names that there are."""
        if name not in self.names:
            raise InputError(f"there is no {brief(name)}", file=self.source, expected="one of " + some(self.names))
        return self.names.index(name)


def z_up(positions: Floats, up: str) -> Floats:
    """Turn positions (..., 3) so that Z is up.

    Args:
        positions: In axes of which another one may be up.
        up: The axis that is up, one of :data:`~poseppl.motion.io.units_and_axes.AXES`.
    """
    x, y, z = np.moveaxis(positions, -1, 0)
    turned = {"x": (y, z, x), "y": (x, -z, y), "z": (x, y, z), "-x": (y, -z, -x), "-y": (x, z, -y), "-z": (x, -y, -z)}
    return np.stack(turned[up], axis=-1)


def y_up(positions: Floats) -> Floats:
    """Positions (..., 3) with Y up of those with Z up, the inverse of :func:`z_up`."""
    x, y, z = np.moveaxis(positions, -1, 0)
    return np.stack([x, z, -y], axis=-1)


def joint_positions(
    parents: Sequence[int],
    offsets: Sequence[Floats] | Floats,
    rotations: Sequence[Rotation],
    root: Floats,
) -> Floats:
    """Forward kinematics: p_child = p_parent + R_parent t_child, R_child = R_parent Q_child.

    Args:
        parents: Index of each joint's parent, which precedes it; -1 for the root.
        offsets: t, of each joint from its parent in the parent's axes, (3,) or (T, 3).
        rotations: Q, of each joint relative to its parent, T each.
        root: Positions (T, 3) of the root.

    Returns:
        Positions (T, J, 3), in the unit of the offsets.
    """
    positions = np.repeat(root[:, None], len(parents), axis=1)
    world: list[Rotation] = []
    for joint, (parent, rotation) in enumerate(zip(parents, rotations, strict=True)):
        if parent >= 0:
            positions[:, joint] = positions[:, parent] + world[parent].apply(offsets[joint])
            rotation = world[parent] * rotation
        world.append(rotation)
    return positions


def slice_frames(motion: Motion, frames: str | FrameRange) -> Motion:
    """Take a range of frames.

    Args:
        motion: The motion, T frames.
        frames: The range, or its text.

    Returns:
        The motion of those frames, its rate divided by the step.

    Raises:
        InputError: The range is malformed, empty or goes beyond the recording.
    """
    part = (FrameRange.parse(frames) if isinstance(frames, str) else frames).within(len(motion.positions), motion.source)
    return replace(motion, positions=motion.positions[part], rate=motion.rate / part.step)


RATE_TOLERANCE = 1e-3
"""By which share of it a rate may miss a whole fraction of another."""


def whole_step(rate: float, wanted: float) -> int | None:
    """Every which frame of a rate makes it another one; None if there is none.

    >>> whole_step(120.0, 30.0), whole_step(119.9, 60.0), whole_step(120.0, 25.0), whole_step(30.0, 60.0)
    (4, 2, None, None)
    """
    step = round(rate / wanted)
    return step if step >= 1 and abs(rate / wanted - step) <= RATE_TOLERANCE * step else None


def resample(motion: Motion, rate: float) -> Motion:
    """Bring a motion to a lower rate.

    If every n-th frame has that rate, these frames are selected. Otherwise points lie on the straight line between the frames
    before and after their time; a point that is missing in either frame is missing. An arm of 600 mm that swings by 6 radians a
    second is 0.2 mm short in the middle between frames of 120 Hz.

    Args:
        motion: The motion, T frames.
        rate: Frames a second.

    Returns:
        The motion from the same first frame on.

    Raises:
        InputError: The rate is none, or higher than the motion's.
    """
    if not 0 < rate <= motion.rate * (1 + RATE_TOLERANCE):
        problem = f"{motion.rate:g} frames a second cannot be made {rate:g}"
        raise Location(motion.source).error(problem, f"above 0, at most {motion.rate:g}")
    step = whole_step(motion.rate, rate)
    if step is not None:
        return replace(motion, positions=motion.positions[::step], rate=motion.rate / step)
    last = len(motion.positions) - 1
    times = np.arange(int(last * rate / motion.rate + 1e-9) + 1) * (motion.rate / rate)
    before = np.minimum(times.astype(int), last)
    share = (times - before)[:, None, None]
    start, end = motion.positions[before], motion.positions[np.minimum(before + 1, last)]
    return replace(motion, positions=np.where(share > 0, (1 - share) * start + share * end, start), rate=rate)
