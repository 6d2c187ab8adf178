"""Recordings as poses of a body: what a model of an activity is trained on."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.files.frame_range import FrameRange
from poseppl.motion.bodies.body import load_builder
from poseppl.motion.bodies.subject import fit_subject
from poseppl.motion.io import Motion, read_motion, slice_frames
from poseppl.motion.io.motion import RATE_TOLERANCE, whole_step

_MIN_RATE = 5.0
"""Frames a second that a common rate has at least."""


class PosedRecording(NamedTuple):
    """A recording as poses.

    Attributes:
        states: (T, d), angles without jumps of a whole turn.
        coordinates: Names of the d coordinates.
        root: Name of the joint that the body hangs on.
        rate: Frames a second.
        person: Its person: recordings of one person share a mean pose.
        source: Its file.
        residual: Mean distance (mm) of the markers from those of the states.
    """

    states: Floats
    coordinates: tuple[str, ...]
    root: str
    rate: float
    person: str
    source: str
    residual: float


def skeleton_of(path: FilePath) -> Path | None:
    """The skeleton beside an .amc file that is called as CMU does: ``07.asf`` beside ``07_01.amc``; None if there is none."""
    file = Path(path)
    found = re.fullmatch(r"(.+)_[0-9]+", file.stem)
    if file.suffix.lower() != ".amc" or found is None:
        return None
    beside = file.with_name(f"{found[1]}.asf")
    return beside if beside.is_file() else None


class Recording(NamedTuple):
    """A recorded `motion`, and whom it is of: recordings of one `person` share its mean pose."""

    motion: Motion
    person: str


def read_recording(path: FilePath, skeleton: FilePath | None = None, *, rate: float | None = None) -> Recording:
    """Read a recording; its person is called as the skeleton's file, or without one as its own.

    Args:
        path: As :func:`poseppl.motion.io.read_motion` takes it.
        skeleton: Its skeleton; the one of :func:`skeleton_of` if None.
        rate: Frames a second, where the format does not tell.

    Raises:
        InputError: The file cannot be read.
    """
    skeleton = skeleton_of(path) if skeleton is None else skeleton
    return Recording(read_motion(path, skeleton, rate=rate), Path(path if skeleton is None else skeleton).stem)


def pose_recording(recording: Recording, model: str, rate: float | None = None) -> PosedRecording:
    """Find the poses of a recorded person by inverse kinematics.

    Args:
        recording: The recording.
        model: Builder of the body.
        rate: Frames a second of the poses: those of the recording divided by a whole number; the recording's own if None.

    Raises:
        InputError: The recording lacks the body's joints, or its rate cannot be made that one.
    """
    motion, person = recording
    step = frames_between(motion.rate, motion.rate if rate is None else rate, motion.source)
    subject = fit_subject(slice_frames(motion, FrameRange(step=step)), load_builder(model))
    tree = subject.body.tree
    labels = tree.coordinate_names, tree.joint_names[0], subject.rate
    return PosedRecording(subject.states, *labels, person, motion.source, float(subject.residual or 0.0))


def frames_between(rate: float, wanted: float, source: str) -> int:
    """Every which frame of a recording makes it one of another rate.

    Raises:
        InputError: None does.
    """
    step = whole_step(rate, wanted)
    if step is None:
        rates = ", ".join(f"{rate / n:g}" for n in (1, 2, 3, 4))
        raise InputError(
            f"{rate:g} frames a second cannot be made {wanted:g}",
            file=source,
            expected=Phrase(Argument("rate", rates), ", ..."),
        )
    return step


def common_rate(rates: Sequence[float]) -> float:
    """The highest rate that every one of these becomes when some of its frames are left out."""
    slowest = min(rates)
    for divisor in range(1, 1 + int(slowest / _MIN_RATE)):
        ratios = np.asarray(rates, np.float64) * divisor / slowest
        if np.all(np.abs(ratios - np.round(ratios)) <= RATE_TOLERANCE * ratios):
            return slowest / divisor
    raise InputError(
        f"no rate is common to {sorted(set(rates))} frames a second",
        field=Argument("files"),
        expected=Phrase(Argument("rate", "HZ")),
    )
