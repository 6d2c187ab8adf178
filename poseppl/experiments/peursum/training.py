"""The one walk that the learned motion comes from, and the file of its tables."""

from __future__ import annotations

from poseppl.errors import InputError
from poseppl.experiments.recordings import Recording
from poseppl.files.cache_folder import cache_folder
from poseppl.files.store import key_of
from poseppl.motion.io.resampling import resample
from poseppl.motion.learned import pose_recording, read_recording, train_factored_motion, write_factored_tables

BODY = "poseppl_models.peursum:full_body"
VERSION = 1
"""Counted up when training comes to mean another thing."""


def trained_file(recording: Recording, rate: float) -> str:
    """Learn the tables at a rate, frames a second, unless they are in the user's cache folder, and tell where they are.

    Raises:
        InputError: The recording cannot be read, is the built-in walk, or is shorter than four steps.
    """
    if recording.path is None:
        raise InputError("the built-in walk is of nobody", field="--motion", expected="recordings of people, with skeletons")
    record = {"recording": recording.digest, "rate": rate, "version": VERSION}
    file = cache_folder("factored-motions") / f"{key_of(record)[:24]}.nc"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        seen = read_recording(recording.path, recording.skeleton)
        posed = pose_recording(seen._replace(motion=resample(seen.motion, rate)), BODY)
        coordinates = [(joint, axis) for joint, _, axis in (name.rpartition(".") for name in posed.coordinates)]
        write_factored_tables(train_factored_motion(posed.states, coordinates, posed.rate), file)
    return str(file)
