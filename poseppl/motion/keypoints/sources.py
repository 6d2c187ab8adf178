"""Keypoints of several cameras in common frames: read, rid of what cannot be, and their clocks brought together."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, FilePath, InputError, Phrase
from poseppl.motion.geometry import Cameras
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.detections import check_different, without_strays
from poseppl.motion.io.keypoint_layouts import plain_name
from poseppl.motion.io.keypoints import read_keypoints
from poseppl.motion.keypoints.clock_offsets import Offsets, coarse_offsets, synchronize
from poseppl.motion.keypoints.clocks import Aligned, Clock, align
from poseppl.motion.keypoints.limb_continuity import limb_pairs, proposed_swaps
from poseppl.motion.keypoints.people import LARGEST_DISTANCE, associate_person
from poseppl.motion.points.swaps import exchanged
from poseppl.motion.tracking.scene import MIN_CONFIDENCE

MIN_OFFSET, SURE = 0.5, 3.0
"""An offset is acted on where it is at least so many frames, and so many standard deviations from none."""
_ROUNDS = 3
_TOLD_FRAMES = 5
LARGEST_RATIO = 50.0
"""A camera's frames, by their times, are at most so many times as far apart as those of the recording, or as near."""
_DAY = 86400.0
"""Seconds; times that begin later are those of a clock, not of a recording."""
_FEW = 0.5
"""A camera that sees someone in a smaller share of its frames is reported."""


class Clocks(NamedTuple):
    """Known clocks of the cameras.

    Attributes:
        rate: Frames a second of the recording.
        rates: Frames a second of cameras that have others.
        offsets: Frames by which cameras are late, where that is known.
        find: Whether offsets that are not known are sought.
    """

    rate: float
    rates: Mapping[str, float] = {}
    offsets: Mapping[str, float] = {}
    find: bool = True


def read_sources(
    sources: Mapping[str, FilePath | DetectedPeople],
    records: Mapping[str, CameraRecord],
    detector: str | None,
    layout: str | None,
) -> tuple[list[DetectedPeople], list[str]]:
    """Read the keypoints of cameras.

    Args:
        sources: Files or folders by the names of their cameras, or what was read of them.
        records: Cameras by name.
        detector: Program that wrote them; detected from their content if None.
        layout: Which points these are; found from them if None.

    Returns:
        The detections of each camera, and notes for the user.

    Raises:
        InputError: A camera is unknown, a file cannot be read, or they have different points.
    """
    check_cameras(sources, records)
    people, notes = [], []
    for name, source in sources.items():
        size = records[name].size
        if isinstance(source, DetectedPeople):
            found = source
        else:
            found = read_keypoints(source, detector, layout=layout, size=size, camera=name, cameras=tuple(records))
        found, note = without_strays(found, size, name)
        people.append(found)
        notes += [f"{name}: {each}" for each in found.notes] + note
        check_confidences(name, found)
        seen = np.isfinite(found.points).any((1, 2, 3)).mean()
        sure = found.confidence[np.isfinite(found.points).all(-1)]
        if sure.size and np.median(sure) > 1:
            notes.append(f"{name}: most confidences are above 1, up to {sure.max():.3g}, and count as 1: 0 to 1 are expected")
        if seen < _FEW:
            notes.append(f"{name}: nobody was found in {1 - seen:.0%} of its {len(found.frames)} frames")
    if len({(found.layout, found.names) for found in people}) > 1:
        kinds = sorted({found.layout or ", ".join(found.names)[:60] for found in people})
        raise InputError(f"cameras with {' and '.join(kinds)}", field=Argument("files"), expected="one layout in all")
    check_different(dict(zip(sources, people, strict=True)))
    return people, notes


def check_cameras(names: Iterable[str], known: Collection[str]) -> None:
    """Check that cameras are known.

    Raises:
        InputError: One is not.
    """
    for name in names:
        if name not in known:
            raise InputError(f"no camera {name!r} in the calibration", field=Argument("files"), expected=", ".join(known))


def check_confidences(name: str, found: DetectedPeople) -> None:
    """Check that some points of a camera have confidence.

    Raises:
        InputError: They have none, so that none would count.
    """
    confidence = found.confidence[np.isfinite(found.points).all(-1)]
    if confidence.size and confidence.max() < MIN_CONFIDENCE:
        raise InputError(
            f"{name}: the confidence of all {confidence.size} points is below {MIN_CONFIDENCE:g}, the largest is "
            f"{confidence.max():.3g}, so that none counts",
            field=Argument("files"),
            expected="confidences from 0 to 1; write 1 for each point if the detector gives none",
        )


def own_clocks(names: Sequence[str], people: Sequence[DetectedPeople], clocks: Clocks) -> list[Clock]:
    """The clocks of cameras, as far as they are known.

    Raises:
        InputError: A name is none, or only some cameras have times.
    """
    for name in (*clocks.offsets, *clocks.rates):
        if name not in names:
            raise InputError(f"no keypoints of a camera {name!r}", field=Argument("camera"), expected=", ".join(names))
    timed = [found.times is not None for found in people]
    if any(timed) and not all(timed):
        missing = ", ".join(name for name, has in zip(names, timed, strict=True) if not has)
        raise InputError(
            f"no times in the files of {missing}", field=Argument("files"), expected="times in all files or in none"
        )
    start = _start_of_times(names, people, clocks.rate) if all(timed) else 0.0
    return [
        Clock(clocks.rates.get(name, clocks.rate) / clocks.rate, clocks.offsets.get(name, 0.0), all(timed), clocks.rate, start)
        for name in names
    ]


def _start_of_times(names: Sequence[str], people: Sequence[DetectedPeople], rate: float) -> float:
    """Seconds from which frames are counted: 0, or the first whole one of times that count from some other day.

    Raises:
        InputError: A camera's times are no seconds of frames at about that rate.
    """
    known = [found.times[np.isfinite(found.times)] for found in people if found.times is not None]
    for name, times in zip(names, known, strict=True):
        gap = float(np.median(np.diff(times))) if len(times) > 1 else 1 / rate
        if not 1 / LARGEST_RATIO <= gap * rate <= LARGEST_RATIO:
            problem = f"the frames of {name} are {gap:.3g} s apart by their times, those of the recording {1 / rate:.3g} s"
            raise InputError(problem, field=Argument("rate"), expected="times in seconds, and the rate of the recording")
    first = min(float(times[0]) for times in known)
    return float(np.floor(first)) if first >= _DAY else 0.0


def align_roughly(names: Sequence[str], people: Sequence[DetectedPeople], clocks: Clocks) -> list[DetectedPeople]:
    """Detections of the cameras in common frames, according to their known clocks."""
    return align(people, own_clocks(tuple(names), people, clocks)).people


def common_frames(
    names: Sequence[str], cameras: Cameras, people: Sequence[DetectedPeople], clocks: Clocks, frames: str | None
) -> tuple[Aligned, list[str]]:
    """Bring cameras to common frames; unknown offsets of their clocks are estimated and reported.

    Args:
        names: C names of cameras.
        cameras: The cameras.
        people: Detections of each camera in its own frames.
        clocks: Known clocks.
        frames: Range "start:stop:step" of the common frames, counted from 0; all if None.

    Raises:
        InputError: A name is none, the cameras have no common frame, or only some have times.
    """
    own = own_clocks(names, people, clocks)
    notes: list[str] = []
    free = [c for c, name in enumerate(names) if name not in clocks.offsets]
    if clocks.find and len(free) > 1:
        late, notes = _found_offsets(names, cameras, people, own, free, clocks.rate)
        own = [clock._replace(offset=clock.offset + late[c] * clock.ratio) for c, clock in enumerate(own)]
    aligned = align(people, own, frames)
    return aligned, notes + _span_notes(names, aligned)


def find_offsets(cameras: Cameras, people: Sequence[DetectedPeople], clocks: Sequence[Clock], rate: float) -> Offsets | None:
    """Frames of the recording by which cameras are late, beyond their clocks; None where it cannot be estimated.

    The search starts from whole frames, and from no offsets. The more precise result is kept: at a wrong shift, such as a
    stride of a walk or another person's, rays miss each other by more, or hardly move.
    """
    coarse = coarse_offsets(cameras, align(people, clocks).people)
    starts = [np.zeros(len(people)), coarse][: 1 + bool(coarse.any())]
    found = [each for start in starts if (each := _offsets_from(start, cameras, people, clocks, rate)) is not None]
    return min(found, key=lambda each: float(each.deviation.mean()), default=None)


def _offsets_from(
    start: Floats, cameras: Cameras, people: Sequence[DetectedPeople], clocks: Sequence[Clock], rate: float
) -> Offsets | None:
    """Offsets found from whole frames.

    The person is chosen with cameras whose clocks agree to half a frame, which takes a second round where they did not.
    """
    found = None
    for _ in range(_ROUNDS):
        shifted = [clock._replace(offset=clock.offset + own * clock.ratio) for clock, own in zip(clocks, start, strict=True)]
        try:
            aligned = align(people, shifted).people
            # cameras that agree no better than this tell nothing of the clocks
            chosen = associate_person(cameras, aligned, rate, largest_alone=LARGEST_DISTANCE)
            points, confidence = points_of(aligned, chosen)
        except InputError:  # nobody is seen by two cameras: what follows says so
            return None
        pairs = list(limb_pairs([plain_name(name) for name in aligned[0].names]).values())
        swaps = proposed_swaps(cameras, points, confidence, pairs, rate)
        beside = synchronize(cameras, exchanged(points, swaps, pairs), exchanged(confidence, swaps, pairs), rate)
        if beside is None:
            return found
        found = Offsets(start + beside.frames, beside.deviation)
        whole = np.round(found.frames)
        if np.array_equal(whole, start):
            break
        start = whole
    return found


def _found_offsets(
    names: Sequence[str],
    cameras: Cameras,
    people: Sequence[DetectedPeople],
    own: Sequence[Clock],
    free: Sequence[int],
    rate: float,
) -> tuple[Floats, list[str]]:
    """Frames of the recording by which cameras are late beside what is known, 0 where it is not sure; what to tell."""
    late = np.zeros(len(names))
    found = find_offsets(cameras, people, own, rate)
    if found is None:
        return late, []
    anchor = next((c for c in range(len(names)) if c not in free), free[0])
    total = found.frames - found.frames[anchor]
    deviation = np.maximum(found.deviation, found.deviation[found.deviation > 0].min())
    notes: list[str] = []
    for c in free:
        if c != anchor and abs(total[c]) >= MIN_OFFSET and abs(total[c]) >= SURE * deviation[c]:
            late[c] = total[c]
            low, high = total[c] - 1.645 * deviation[c], total[c] + 1.645 * deviation[c]
            notes.append(
                Phrase(
                    f"{names[c]}: its clock is {late[c]:+.1f} frames from that of {names[anchor]} (90 % interval {low:+.1f} to "
                    f"{high:+.1f}); this is corrected (",
                    Argument("camera", f"{names[c]}:offset=FRAMES"),
                    " sets another, ",
                    Argument("keep", "clocks"),
                    " disables it)",
                )
            )
    return late, notes


def _span_notes(names: Sequence[str], aligned: Aligned) -> list[str]:
    """Cameras that begin later or end earlier than the frames that are taken."""
    first, last = aligned.frames[0], aligned.frames[-1]
    notes = []
    for name, (begin, end) in zip(names, aligned.spans, strict=True):
        if begin > first + _TOLD_FRAMES:
            notes.append(f"{name}: it begins at frame {begin:.0f}, the others at {first}; before that it sees nobody")
        if end < last - _TOLD_FRAMES:
            notes.append(f"{name}: it ends at frame {end:.0f}, the others at {last}; after that it sees nobody")
    return notes


def points_of(people: Sequence[DetectedPeople], chosen: Integers) -> tuple[Floats, Floats]:
    """Points (T, C, K, 2) and confidence (T, C, K) of one person."""
    rows = np.arange(len(chosen))
    absent = chosen < 0
    points = np.stack([found.points[rows, chosen[:, c]] for c, found in enumerate(people)], 1)
    confidence = np.stack([found.confidence[rows, chosen[:, c]] for c, found in enumerate(people)], 1)
    return np.where(absent[..., None, None], np.nan, points), np.where(absent[..., None], 0.0, confidence)
