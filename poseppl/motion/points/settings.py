"""Settings of named points: of animals and things, each point by itself or linked to others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from poseppl.motion.settings import CameraFiles, File, Frames, at_least


@dataclass(frozen=True)
class PointSettings(CameraFiles):
    """How named points of an animal or a thing are read and smoothed.

    Attributes:
        skeleton: File of the points that are wanted, and of links and left and right pairs of them; in Python also a Skeleton.
            Default: all points of the files, not linked.
        detector: Program that wrote the files: deeplabcut, sleap or another that names its points. Default: detected.
        person: Number of the individual, from 1, in the order of the file that names most.
        frames: Frames A:B:C of those that any file has: A to B - 1 in steps of C, counted from 0. Default: all.
        max_draws: Draws of all trajectories.
        seed: Seed of the draws.
    """

    skeleton: File | Any = None
    detector: str | None = None
    person: Annotated[int, at_least(1)] = 1
    frames: Frames | None = None
    max_draws: Annotated[int, at_least(1)] = 200
    seed: Annotated[int, at_least(0)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check_one_clock()
