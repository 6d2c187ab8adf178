"""Points that a detector found in one camera's pictures, whatever it is and whatever file they come from.

A detector has a list of points, and in each frame finds them for some people, or animals. Readers hand over a table of x, y and
confidence. A point is missing where x, y or the confidence is no number (DeepLabCut writes NaN beside a likelihood of 1.0), and
where x and y are both 0, as OpenPose has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError, Location, brief
from poseppl.motion.io.text_parsing import LARGEST, LONGEST, check_distinct

MAX_FRAMES = 1_000_000
MAX_PEOPLE = 100
MAX_POINTS = 1_000
"""Largest number of points of one person."""
MAX_VALUES = 40_000_000
"""Numbers in a camera's table: frames x people x points x 3."""
FAR_OUTSIDE = 1.0
"""A point farther outside of the picture than this share of its width or height is none."""


class DetectedPeople(NamedTuple):
    """Detections in one camera's pictures.

    Attributes:
        points: (T, P, K, 2) pixels; P is the largest number of people in a frame; NaN where a point was not found.
        confidence: (T, P, K), as the detector has it; 0 where a point was not found.
        frames: (T,) consecutive frame numbers.
        layout: Which points these are, a key of :data:`~poseppl.motion.io.keypoint_layouts.LAYOUTS`; "" where they have
            names of their own.
        names: K names of the points.
        individuals: P names, where the detector says who is who in all frames; () where P is an order within a frame alone.
        times: (T,) seconds, NaN where unknown; None where the file has none.
        notes: Omissions of the reader, a sentence each.
    """

    points: Floats
    confidence: Floats
    frames: Integers
    layout: str
    names: tuple[str, ...]
    individuals: tuple[str, ...] = ()
    times: Floats | None = None
    notes: tuple[str, ...] = ()


def detected_people(
    people: Mapping[int, Sequence[Floats]],
    names: Sequence[str],
    at: Location,
    *,
    individuals: Sequence[str] = (),
    times: Mapping[int, float] | None = None,
) -> DetectedPeople:
    """Lay out what was found in each frame.

    Args:
        people: By frame number, the people, each (K, 3): x, y, confidence.
        names: K names of the points.
        at: The file, for messages.
        individuals: Names of the people, in the order of each frame's.
        times: Seconds by frame number.

    Returns:
        The detections, from the first to the last frame number; frames between that are not there have nobody.

    Raises:
        InputError: There is no frame or nobody in any, too many of something, a number is too large, or a name comes twice.
    """
    if not people:
        raise at.error("the file has no frame", "at least one")
    first, last = min(people), max(people)
    count = max(map(len, people.values()))
    if last - first >= MAX_FRAMES:
        raise at.error(f"frames {first} to {last}", f"at most {MAX_FRAMES} frames")
    check_room(last - first + 1, count, len(names), at)
    check_names(names, "points", at)
    table = np.full((last - first + 1, count, len(names), 3), np.nan)
    for number, found in people.items():
        for index, person in enumerate(found):
            table[number - first, index] = person
    numbers = np.arange(first, last + 1)
    clock = np.array([(times or {}).get(int(number), np.nan) for number in numbers])
    known = np.flatnonzero(np.isfinite(clock))
    back = np.flatnonzero(np.diff(clock[known]) < 0)
    if back.size:
        raise at.error(f"the time of frame {numbers[known[back[0] + 1]]} is before that of the frame before", "ascending times")
    timed = clock if known.size else None
    return people_of_table(table, numbers, names, at)._replace(individuals=tuple(individuals), times=timed)


def check_room(frames: int, people: int, points: int, at: Location) -> None:
    """Check, before room is made for them, that there are not too many people, points, or numbers in all.

    Raises:
        InputError: There are.
    """
    if people > MAX_PEOPLE or points > MAX_POINTS:
        raise at.error(f"{people} people of {points} points in a frame", f"at most {MAX_PEOPLE} and {MAX_POINTS}")
    if frames * people * points * 3 > MAX_VALUES:
        raise at.error(f"{frames} frames of {people} x {points} points", f"at most {MAX_VALUES} numbers")


def people_of_table(table: Floats, frames: Integers, names: Sequence[str], at: Location) -> DetectedPeople:
    """Split a table (T, P, K, 3) of x, y, confidence into points and confidence.

    Raises:
        InputError: Nobody is in any frame, or a number is too large.
    """
    large = np.argwhere(np.abs(np.where(np.isnan(table), 0.0, table)) > LARGEST)
    if len(large):
        t, p, k, field = large[0]
        where = at.in_field(f"frame {frames[t]}, person {p + 1}, {names[k]}, {('x', 'y', 'confidence')[field]}")
        raise where.error(f"the number {table[t, p, k, field]:g} is too large", "pixels, at most 1e9")
    missing = ~np.isfinite(table).all(-1) | (table[..., :2] == 0).all(-1)
    if missing.all():
        raise at.error(f"nothing was found in any of {len(frames)} frames", "at least one point in one frame")
    points = np.where(missing[..., None], np.nan, table[..., :2])
    return DetectedPeople(points, np.where(missing, 0.0, table[..., 2]), frames, "", tuple(names))


def check_names(names: Sequence[str], kind: str, at: Location) -> None:
    """Check names of points or individuals: there is one, none is empty or very long, and no two are equal."""
    if not names:
        raise at.error(f"no {kind}", "at least one")
    for name in names:
        if not 0 < len(name) <= LONGEST:
            raise at.error(f"{brief(name)} as a name of {kind}", f"1 to {LONGEST} characters")
    check_distinct(names, kind, at)


def check_different(found: Mapping[str, DetectedPeople]) -> None:
    """Check that no two cameras saw the same to the last digit: one file was given to both.

    Raises:
        InputError: Two did.
    """
    for one, other in combinations(found, 2):
        if np.array_equal(found[one].points, found[other].points, equal_nan=True):
            problem = f"{one} and {other} have the same points in all frames"
            raise InputError(problem, field=Argument("files"), expected="a file of its own for each camera")


def without_strays(found: DetectedPeople, size: tuple[int, int], name: str) -> tuple[DetectedPeople, list[str]]:
    """Take away points that lie far outside of the picture, and tell of them."""
    extent = np.array(size, float)
    with np.errstate(invalid="ignore"):
        far = (found.points < -FAR_OUTSIDE * extent) | (found.points > (1 + FAR_OUTSIDE) * extent)
    stray = np.any(far, axis=-1)
    if not stray.any():
        return found, []
    t, p, k = np.argwhere(stray)[0]
    x, y = found.points[t, p, k]
    note = (
        f"{name}: {stray.sum()} points lie far outside of its picture of {size[0]} x {size[1]} px and count as not seen, "
        f"the first in frame {found.frames[t]}, {found.names[k]}, at ({x:.4g}, {y:.4g})"
    )
    points = np.where(stray[..., None], np.nan, found.points)
    return found._replace(points=points, confidence=np.where(stray, 0.0, found.confidence)), [note]
