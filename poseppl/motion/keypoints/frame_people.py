"""Detections that come frame by frame, laid out as those of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import FilePath, InputError, Location
from poseppl.motion.io import DetectedPeople
from poseppl.motion.io.growing_folders import KeypointFrame
from poseppl.motion.io.json_people import same_points
from poseppl.motion.io.layout_guess import with_layout


def first_people(
    folders: Mapping[str, FilePath], frames: Sequence[KeypointFrame], layout: str | None
) -> dict[str, DetectedPeople]:
    """What the cameras saw in the first frames.

    Raises:
        InputError: Nobody was seen, or people have different points, or points of no layout.
    """
    found = {}
    for camera, (name, folder) in enumerate(folders.items()):
        people = {frame.number: frame.people[camera] or [] for frame in frames}
        found[name] = laid_out(people, layout, Location(folder))
    known = next((each for each in found.values() if each is not None), None)
    if known is None:
        raise InputError(f"nobody was found in any of {len(frames)} frames", field="--keypoints", expected="a person")
    numbers = [frame.number for frame in frames]
    return {name: each or nobody(numbers, known.layout, known.names) for name, each in found.items()}


def laid_out(people: Mapping[int, list[Floats]], layout: str | None, at: Location) -> DetectedPeople | None:
    """People of frames that follow each other; None where there is nobody.

    Raises:
        InputError: They have different points, or points of no layout.
    """
    seen = {number: [each for each in found if np.nan_to_num(each[:, :2]).any()] for number, found in people.items()}
    return with_layout(same_points(seen, at), layout, at) if any(seen.values()) else None


def nobody(frames: Sequence[int], layout: str, names: tuple[str, ...]) -> DetectedPeople:
    """Frames in which nobody is."""
    shape = len(frames), 1, len(names)
    return DetectedPeople(np.full((*shape, 2), np.nan), np.zeros(shape), np.array(frames), layout, names)
