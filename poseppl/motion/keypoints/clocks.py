"""The cameras' clocks: which frame of a camera is of which time, and constant offsets that the cameras tell themselves.

The frames of the recording are counted at one rate. In a camera with ``ratio`` times as many frames a second, and
``offset`` frames late, what happens in frame n of the recording is in frame ``ratio n + offset``; a camera whose file has
times has these instead. Between two frames of a camera its points are interpolated, each person's with the one that lies
nearest in the frame after.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.files.frame_range import FrameRange
from poseppl.motion.io import DetectedPeople

EXACT = 1e-3
"""Nearer to a frame than this, it is that frame."""
_FAR = 1e9
"""A place in the list of frames that is outside of it, whatever the offset."""
_STRIDE = 0.5
"""Detections of successive frames are of one person where they are nearer than this share of its height or width."""


class Clock(NamedTuple):
    """A camera's frames: ``ratio n + offset`` is of frame n of the recording; or its own times, seconds.

    Attributes:
        ratio: Frames of the camera for one of the recording.
        offset: Frames of the camera by which it is late.
        times: Whether the file's own times are taken instead of ``ratio``.
        rate: Frames a second of the recording.
        start: Time of the recording's frame 0, in the files' own seconds.
    """

    ratio: float = 1.0
    offset: float = 0.0
    times: bool = False
    rate: float = 1.0
    start: float = 0.0

    def positions(self, found: DetectedPeople, numbers: Integers) -> Floats:
        """Positions of the recording's frames in the camera's list of frames, from 0; they may lie outside of the list."""
        if not self.times or found.times is None:
            return np.asarray(self.ratio * numbers + self.offset - found.frames[0])
        known = np.isfinite(found.times)
        places, seconds = np.flatnonzero(known).astype(float), found.times[known] - self.start
        return np.asarray(np.interp(numbers / self.rate, seconds, places, left=-_FAR, right=_FAR) + self.offset)

    def span(self, found: DetectedPeople) -> tuple[float, float]:
        """The recording's frames that the camera's first and last frame are of."""
        if not self.times or found.times is None:
            first, last = (float(found.frames[end]) for end in (0, -1))
            return (first - self.offset) / self.ratio, (last - self.offset) / self.ratio
        known = found.times[np.isfinite(found.times)] - self.start
        return float(known[0] * self.rate), float(known[-1] * self.rate)


class Aligned(NamedTuple):
    """Detections of cameras in common frames.

    Attributes:
        people: Detections of each camera in the same T frames; nobody where it has no frame.
        frames: (T,) their numbers.
        spans: (C, 2) first and last of the recording's frames that a camera has.
    """

    people: list[DetectedPeople]
    frames: Integers
    spans: Floats


def align(people: Sequence[DetectedPeople], clocks: Sequence[Clock], frames: str | None = None) -> Aligned:
    """Bring cameras to common frames, from the first to the last that two of them have.

    Args:
        people: Detections of each camera.
        clocks: Their clocks.
        frames: Range "start:stop:step" of these frames, counted from 0; all if None.

    Raises:
        InputError: No two cameras have a common frame, or one has none with any other.
    """
    spans = np.array([clock.span(found) for clock, found in zip(clocks, people, strict=True)])
    low, high = np.ceil(spans[:, 0] - EXACT), np.floor(spans[:, 1] + EXACT)
    others = [np.delete(np.arange(len(people)), c) for c in range(len(people))]
    alone = len(people) > 1 and any((low[c] > high[o].max()) or (high[c] < low[o].min()) for c, o in enumerate(others))
    if alone or np.any(low > high):
        spanned = ", ".join(f"{first:.0f} to {last:.0f}" for first, last in spans)
        raise InputError(f"no common frame: {spanned}", field=Argument("files"), expected="files of the same frame numbers")
    second = min(2, len(people)) - 1
    first, last = int(np.sort(low)[second]), int(np.sort(high)[::-1][second])
    numbers = np.arange(first, last + 1)
    numbers = numbers[FrameRange.parse(frames).within(len(numbers), "the files' common frames")]
    found = [resampled(one, clock.positions(one, numbers), numbers) for one, clock in zip(people, clocks, strict=True)]
    return Aligned(found, numbers, spans)


def resampled(found: DetectedPeople, positions: Floats, numbers: Integers) -> DetectedPeople:
    """A camera's detections at places between its frames.

    Args:
        found: Its detections in T frames.
        positions: (N,) places in the list of these, from 0; nobody is seen outside of it.
        numbers: (N,) numbers of the frames that these are.
    """
    total = len(found.points)
    inside = (positions >= -EXACT) & (positions <= total - 1 + EXACT)
    before = np.clip(np.floor(positions + EXACT).astype(int), 0, total - 1)
    part = np.where(inside, np.clip(positions - before, 0.0, 1.0), 0.0)
    points, confidence = found.points[before].copy(), found.confidence[before].copy()
    for row in np.flatnonzero((part > EXACT) & inside):
        after = min(before[row] + 1, total - 1)
        _interpolate(points[row], confidence[row], found.points[after], found.confidence[after], part[row])
    points[~inside], confidence[~inside] = np.nan, 0.0
    return found._replace(points=points, confidence=confidence, frames=numbers, times=None)


def _interpolate(points: Floats, confidence: Floats, next_points: Floats, next_confidence: Floats, part: float) -> None:
    """Move people (P, K, 2) a part of the way to where they are in the next frame; who is not there any more stays or goes."""
    for p in range(len(points)):
        seen = np.isfinite(points[p]).all(-1)
        if not seen.any():
            continue
        extent = max(float(np.ptp(points[p][seen], axis=0).max()), 1.0)
        apart = np.full(len(next_points), np.inf)
        for q in range(len(next_points)):
            both = seen & np.isfinite(next_points[q]).all(-1)
            if both.any():
                apart[q] = np.median(np.linalg.norm(points[p][both] - next_points[q][both], axis=-1))
        q = int(apart.argmin())
        if apart[q] > _STRIDE * extent:
            continue
        both = seen & np.isfinite(next_points[q]).all(-1)
        points[p][both] += part * (next_points[q][both] - points[p][both])
        confidence[p][both] = np.minimum(confidence[p][both], next_confidence[q][both])
        lost = seen & ~both if part > 0.5 else np.zeros_like(seen)
        points[p][lost], confidence[p][lost] = np.nan, 0.0
