"""The one walk that the learned motion comes from, and the file of its tables."""

from __future__ import annotations

from poseppl.files.cache_folder import cache_folder
from poseppl.files.store import key_of
from poseppl.motion.io import Motion, read_motion, resample
from poseppl.motion.learned import pose_recording, train_factored_motion, write_factored_tables
from poseppl.motion.learned.posed_recordings import Recording as Recorded
from poseppl.motion.recordings.subjects import walking_subject
from poseppl_papers.recordings import Recording

BODY = "poseppl_models.peursum.marker_body:full_body"
_SECONDS = 3.0
"""Length of the built-in walk."""
VERSION = 2
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
        coordinates = [(joint, axis) for joint, _, axis in (name.rpartition(".") for name in posed.coordinates)]
        write_factored_tables(train_factored_motion(posed.states, coordinates, posed.rate), file)
    return str(file)
