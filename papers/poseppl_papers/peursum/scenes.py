"""Scenes like the paper's (section 5.1): a person who walks in a circle, as in HumanEva, and one who walks among furniture.

HumanEva's actors walk in a circle on a mat of 3 m by 3 m, 640 x 480 px at 60 frames a second. The CLUTTER videos have four
cameras below the ceiling, in the corners of a room of 7 m by 6 m with a table and chairs. They have 384 x 288 px at 25 frames a
second.
"""

from __future__ import annotations

from collections.abc import Sequence

from poseppl.errors import InputError
from poseppl_papers.images.scenes import Scene
from poseppl_papers.recordings import Recording

NUM_CIRCLES, NUM_CLUTTERED = 5, 5
RADIUS = 1200.0
"""Radius of the circles (mm): the pelvis keeps 300 mm away from the edge of the mat."""


def circle_scenes(recordings: Sequence[Recording], number: int = NUM_CIRCLES, num_frames: int = 150) -> list[Scene]:
    """Walks along circles without furniture, one for each of the first recordings.

    Args:
        recordings: Straight walks, as many as scenes or more.
        number: Number of scenes.
        num_frames: At 60 frames a second.

    Raises:
        InputError: There are too few recordings.
    """
    return [
        Scene(each, False, num_frames, rate=60.0, width=640, height=480, radius=RADIUS) for each in _first(recordings, number)
    ]


def clutter_scenes(
    recordings: Sequence[Recording], number: int = NUM_CLUTTERED, num_frames: int = 60, *, announced: bool = False
) -> list[Scene]:
    """Walks among furniture, one for each of the first recordings: it is placed beside each path separately.

    The table comes to stand beside the middle of the path in all of them, the chairs up to 1.5 m elsewhere.

    Args:
        recordings: Walks, as many as scenes or more.
        number: Number of scenes.
        num_frames: At 25 frames a second.
        announced: Whether trackers are given the pixels of the furniture, which those of the paper are not.

    Raises:
        InputError: There are too few recordings.
    """
    return [
        Scene(each, True, num_frames, rate=25.0, width=384, height=288, announced=announced)
        for each in _first(recordings, number)
    ]


def _first(recordings: Sequence[Recording], count: int) -> Sequence[Recording]:
    if len(recordings) < count:
        expected = f"{count} walks, one for each scene, and the one that the motion is learned from"
        raise InputError(f"{len(recordings)} walks to look at", field="--motion", expected=expected)
    return recordings[:count]
