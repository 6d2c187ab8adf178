"""Scenes like the paper's (section 5.1), and the one walk that the learned motion comes from.

HumanEva's actors walk in a circle on a mat of 3 m by 3 m, 640 x 480 px at 60 frames a second. The CLUTTER videos have four
cameras below the ceiling, in the corners of a room of 7 m by 6 m with a table and chairs. They have 384 x 288 px at 25 frames a
second.
"""

from __future__ import annotations

from collections.abc import Sequence

from poseppl.errors import InputError
from poseppl.files.cache_folder import cache_folder
from poseppl.files.store import key_of
from poseppl.motion.io import Motion, read_motion, resample
from poseppl.motion.learned import learn_factored_motion, pose_recording, write_factored_motion
from poseppl.motion.learned.posed_recordings import Recording as Recorded
from poseppl.motion.recordings.subjects import walking_subject
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


BODY = "poseppl_models.peursum.marker_body:full_body"
_SECONDS = 3.0
"""Length of the built-in walk."""
VERSION = 3
"""Counted up when training comes to mean another thing."""


def motion_at(recording: Recording, rate: float) -> Motion:
    """A recording at a rate, frames a second; of the built-in walk a few steps.

    Raises:
        InputError: The recording cannot be read.
    """
    if recording.path is not None:
        return resample(read_motion(recording.path, recording.skeleton), rate)
    walk = walking_subject(frames=f"0:{round(_SECONDS * rate)}", rate=rate)
    return Motion(walk.body.tree.marker_names, walk.markers, (), rate, recording.name)


def trained_file(recording: Recording, rate: float) -> str:
    """Learn the tables at a rate, frames a second, unless they are in the user's cache folder, and tell where they are.

    Raises:
        InputError: The recording cannot be read or is shorter than four steps.
    """
    record = {"recording": recording.digest, "rate": rate, "version": VERSION}
    file = cache_folder("factored-motions") / f"{key_of(record)[:24]}.nc"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        posed = pose_recording(Recorded(motion_at(recording, rate), recording.name), BODY)
        write_factored_motion(learn_factored_motion(posed, BODY), file)
    return str(file)
