"""A recorded motion: points in space over time, whichever format it came from.

Every reader yields millimetres and Z up: a Y-up recording's (x, y, z) becomes (x, -z, y).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from poseppl.arrays import Floats
from poseppl.errors import InputError, brief
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
        up: The axis that is up, one of :data:`~poseppl.motion.io.vertical_axis.AXES`.
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
