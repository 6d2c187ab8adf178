"""The tracked person, the people of the training recordings, and the job: runs of a filter with what was learned from them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from poseppl.errors import InputError
from poseppl.files.cache_folder import cache_folder
from poseppl.files.store import key_of
from poseppl.motion.learned import (
    PosedRecording,
    TrainingSettings,
    pose_recording,
    read_motion_model,
    read_recording,
    train_motion_model,
    write_motion_model,
)
from poseppl_papers.images.systems import problem_of
from poseppl_papers.images.tracking import Tracking, compiled_step, first_state, run_once
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import stacked
from poseppl_papers.tables import grouped

BODY = "poseppl_models.darby.marker_body:full_body"
VERSION = 1
"""Counted up when training comes to mean another thing."""


@dataclass(frozen=True)
class Training:
    """Training data of a motion.

    Attributes:
        recordings: The recordings, in the order in which frames are taken of them.
        frames: Frames of each person, at most.
        rate: Frames a second.
        rounds: Rounds of Baum-Welch.
        subject: Name of the person who is tracked; empty where it is none of these.
    """

    recordings: tuple[Recording, ...]
    frames: int
    rate: float
    rounds: int = 50
    subject: str = ""


def person_of(recording: Recording) -> str:
    """A person is called as the skeleton's file."""
    return Path(recording.skeleton or recording.path or "").stem


def first_of_each(recordings: Sequence[Recording], number: int) -> list[Recording]:
    """The first recordings of each person, at most so many."""
    return [recording for mine in grouped(recordings, person_of).values() for recording in mine[:number]]


def known(tracked: Recording, recordings: Sequence[Recording], frames: int, rate: float, rounds: int) -> Training | None:
    """Learn from the person's other recordings; None if there are none."""
    others = tuple(each for each in recordings if person_of(each) == person_of(tracked) and each != tracked)
    return Training(others, frames, rate, rounds, person_of(tracked)) if others else None


def unknown(tracked: Recording, recordings: Sequence[Recording], frames: int, rate: float, rounds: int) -> Training:
    """Learn from the three persons who come next, of those of several recordings first.

    Raises:
        InputError: There is nobody else.
    """
    people = list(dict.fromkeys(person_of(each) for each in recordings))
    at = people.index(person_of(tracked))
    after = people[at + 1 :] + people[:at]
    chosen = sorted(after, key=lambda name: sum(person_of(each) == name for each in recordings) < 2)[:3]
    others = tuple(each for each in recordings if person_of(each) in chosen)
    if not others:
        raise InputError(
            "one person alone", field="--motion", expected="recordings of others, too, or parts that learn nothing"
        )
    return Training(others, frames, rate, rounds)


def trained_file(training: Training, seed: int) -> str:
    """Train a model, unless it is in the user's cache folder, and tell where it is."""
    record = {**vars(training), "recordings": [each.digest for each in training.recordings], "seed": seed, "version": VERSION}
    file = cache_folder("motion-models") / f"{key_of(record)[:24]}.nc"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        settings = TrainingSettings(num_rounds=training.rounds, seed=seed)
        write_motion_model(train_motion_model(list(_posed(training)), BODY, settings), file)
    return str(file)


def _posed(training: Training) -> Iterator[PosedRecording]:
    """Poses of the recordings, as many frames of each person as there may be."""
    left: dict[str, int] = {}
    for recording in training.recordings:
        person = person_of(recording)
        room = left.setdefault(person, training.frames)
        if room > 1:
            posed = _poses(recording, training.rate)
            left[person] = room - len(posed.states)
            yield posed._replace(states=posed.states[:room], person=person)


@lru_cache(maxsize=256)
def _poses(recording: Recording, rate: float) -> PosedRecording:
    if recording.path is None:
        raise InputError("the built-in walk is of nobody", field="--motion", expected="recordings of people, with skeletons")
    return pose_recording(read_recording(recording.path, recording.skeleton), BODY, rate)


@dataclass(frozen=True)
class Taught(Tracking):
    """Runs of one filter, each with a newly trained model.

    Attributes:
        training: Training data; seeds of training are those of the runs.
    """

    training: Training | None = None


def track_taught(job: Taught) -> dict[str, Any]:
    """Run the filter; what is returned is as that of :func:`poseppl_papers.images.tracking.track`."""
    assert job.training is not None
    files = [trained_file(job.training, run) for run in job.runs]
    system = job.system.with_settings(model=files[0], subject=job.training.subject or None)
    problem = problem_of(job.scene, system, job.num_frames)
    filter, step = compiled_step(job.scene, system, job.num_frames, job.method)
    learned, rows = problem.system.learned, []
    assert learned is not None and learned.taught is not None
    for run, file in zip(job.runs, files, strict=True):
        model = read_motion_model(file)
        taught = problem._replace(frames=[learned.taught(inputs, model) for inputs in problem.frames])
        rows.append(run_once(taught, step, first_state(taught, filter, run), run, job.weighs))
    return stacked(rows)
