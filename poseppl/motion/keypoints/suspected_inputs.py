"""Cameras whose keypoints contradict the calibration, the rate or the frame numbers that they come with.

A wrong picture size, a wrong rate and frame numbers of another count all look like a wrong calibration later. Each leaves a
trace of its own here, and is only suspected if the rays of several cameras meet better by far without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError, Phrase
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import with_size
from poseppl.motion.keypoints.calibration_units import meeting_rays
from poseppl.motion.keypoints.clock_offsets import coarse_offsets
from poseppl.motion.keypoints.clocks import Clock, align
from poseppl.motion.keypoints.sources import Clocks, own_clocks
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.scene import MIN_CONFIDENCE

BETTER = 0.75
"""Rays meet better by far if they pass each other at less than this share of the distance."""
SIZES = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 3.0, 4.0)
"""Sizes of pictures over the calibrated one that are tried."""
RATES = tuple(sorted({a / b for a, b in product((1, 2, 3, 4, 5, 6, 8, 10, 12), repeat=2) if a != b}))
"""Rates of a camera over that of the recording that are tried."""
_NEAR = 0.05
"""A camera's number of frames is that of a rate if it differs by less than this share."""
_CORNER, _OUTSIDE = 0.55, 0.2
"""Points in this upper left part of the picture alone, or this share of them outside of it, cast doubt on its size."""


class SeenFrames(NamedTuple):
    """Cameras and what they saw, in their own frames.

    Attributes:
        records: C cameras.
        people: Detections of each camera.
        clocks: Known clocks.
    """

    records: Sequence[CameraRecord]
    people: Sequence[DetectedPeople]
    clocks: Sequence[Clock]

    @property
    def names(self) -> list[str]:
        """Names of the cameras."""
        return [record.name for record in self.records]

    def misfit(self, of: Sequence[int]) -> float:
        """Median distance of rays of two cameras over the size of what they see, at the best offsets in whole frames.

        Args:
            of: Numbers of cameras, of which one at least is in each pair.

        Returns:
            The distance; infinite if no two cameras see anybody together.
        """
        cameras, clocks = cameras_of_records(self.records), self.clocks
        try:
            late = coarse_offsets(cameras, align(self.people, clocks).people)
            moved = [clock._replace(offset=clock.offset + own * clock.ratio) for clock, own in zip(clocks, late, strict=True)]
            aligned = align(self.people, moved).people
        except InputError:  # they have no common frames
            return np.inf
        apart = [pair.apart for pair in meeting_rays(cameras, aligned) if set(of) & set(pair.cameras)]
        return float(np.median(apart)) if apart else np.inf


def check_inputs(records: Sequence[CameraRecord], people: Sequence[DetectedPeople], clocks: Clocks) -> None:
    """Check that keypoints go with the calibration, the rate and each other's frame numbers.

    Args:
        records: C cameras.
        people: Detections of each camera in its own frames.
        clocks: Known clocks.

    Raises:
        InputError: They do not; the message names the option that corrects it.
    """
    names = [record.name for record in records]
    seen = SeenFrames(records, people, own_clocks(names, people, clocks))
    check_frame_numbers(seen)
    check_sizes(seen)
    check_rates(seen, clocks)


def check_frame_numbers(seen: SeenFrames) -> None:
    """Check that each camera has a frame with points at the time of another's.

    Raises:
        InputError: One has none, although its frames lie between theirs.
    """
    if len(seen.people) < 2 or any(clock.times or clock.ratio != 1 for clock in seen.clocks):
        return
    numbers = []
    for found, clock in zip(seen.people, seen.clocks, strict=True):
        own = found.frames[np.isfinite(found.points).any((1, 2, 3))] - clock.offset
        numbers.append({int(number) for number in np.concatenate([np.floor(own), np.ceil(own)])})
    for c, name in enumerate(seen.names):
        others = set().union(*(own for other, own in enumerate(numbers) if other != c))
        if numbers[c] and others and not numbers[c] & others:
            late = min(numbers[c]) - min(others)
            raise InputError(
                f"{name} shares no frame number with the other cameras: "
                f"it has {_listed(numbers[c])}, they have {_listed(others)}",
                field=Argument("files"),
                expected=Phrase(
                    "the same numbers for frames of the same time, or ",
                    Argument("camera", f"{name}:offset=FRAMES"),
                    f", perhaps {name}:offset={late}",
                ),
            )


def check_sizes(seen: SeenFrames) -> None:
    """Check that the points lie in pictures of the calibrated sizes.

    Raises:
        InputError: Rays meet better by far if the pictures of some or all cameras have another size.
    """
    doubted = [
        c for c, (record, found) in enumerate(zip(seen.records, seen.people, strict=True)) if _doubts_size(record, found)
    ]
    if not doubted or len(seen.people) < 2:
        return
    usual = seen.misfit(doubted)
    tried = {}
    for scale in SIZES:
        sized = {c: with_size(seen.records[c], _times(seen.records[c].size, scale)) for c in doubted}
        records = [sized.get(c, record) for c, record in enumerate(seen.records)]
        tried[scale] = seen._replace(records=records).misfit(doubted)
    scale = min(tried, key=lambda each: tried[each])
    if tried[scale] < BETTER * usual:
        names, calibrated = ", ".join(seen.names[c] for c in doubted), _text(seen.records[doubted[0]].size)
        expected = Phrase("points in px of the calibrated size, or")
        for c in doubted:
            size = Argument("camera", f"{seen.names[c]}:size={_text(_times(seen.records[c].size, scale))}")
            expected = Phrase(expected, " ", size)
        raise InputError(
            f"the points of {names} are those of pictures {scale:.3g} times as wide and high as the calibrated ones of "
            f"{calibrated} px, in which rays meet {usual / tried[scale]:.2g} times as well",
            field=Argument("calibration"),
            expected=expected,
        )


def check_rates(seen: SeenFrames, known: Clocks) -> None:
    """Check that cameras with fewer or more frames than others, whose rate is not known, do not have another rate.

    Raises:
        InputError: Rays meet better by far if one has.
    """
    if len(seen.people) < 2 or any(clock.times for clock in seen.clocks):
        return
    counts = np.array([np.ptp(clock.span(found)) + 1 for found, clock in zip(seen.people, seen.clocks, strict=True)])
    for c in np.argsort(counts):  # of two cameras the slower one is named
        name, share = seen.names[c], counts[c] / np.median(np.delete(counts, c))
        near = min(RATES, key=lambda ratio: abs(np.log(ratio / share)))
        if name in known.rates or abs(np.log(near / share)) > _NEAR:
            continue
        other = [each._replace(ratio=near) if own == c else each for own, each in enumerate(seen.clocks)]
        usual, slower = seen.misfit([c]), seen._replace(clocks=other).misfit([c])
        if slower < BETTER * usual:
            rate, own = f"{known.rate:g}", f"{near * known.rate:g}"
            raise InputError(
                f"{name} has {near:.3g} times as many frames as the others, and at {own} frames a second its points fit theirs "
                f"{usual / slower:.2g} times as well",
                field=Argument("files"),
                expected=Phrase(
                    Argument("camera", f"{name}:rate={own}"), f"; or {name}:rate={rate} if it has the rate of the others"
                ),
            )


def _doubts_size(record: CameraRecord, found: DetectedPeople) -> bool:
    points = found.points[np.isfinite(found.points).all(-1) & (found.confidence >= MIN_CONFIDENCE)]
    if not len(points):
        return False
    share: Floats = points / np.array(record.size)
    outside = ((share > 1) | (share < 0)).any(-1).mean()
    return bool(np.quantile(share, 0.99, axis=0).max() < _CORNER or outside > _OUTSIDE)


def _times(size: tuple[int, int], scale: float) -> tuple[int, int]:
    return round(size[0] * scale), round(size[1] * scale)


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"


def _listed(numbers: set[int]) -> str:
    first = sorted(numbers)[:3]
    return ", ".join(map(str, first)) + (f", ... {max(numbers)}" if len(numbers) > 3 else "")
