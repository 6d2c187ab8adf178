"""Identification of people: the detections of several cameras and frames that belong to one person.

Two detections in two cameras are of one person where the rays of their points pass near each other: the median of the shortest
distances is small. Detections of a frame are joined into groups, nearest pairs first, with one of each camera in a group at
most and all pairs near. Groups of successive frames are linked into the path that explains most confidence, along which nobody
moves faster than people do; the next person's path is that of what remains.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, islice, takewhile
from typing import NamedTuple

import jax
import numpy as np

from poseppl.arrays import Floats, Integers
from poseppl.errors import Argument, InputError
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import nearest_points, ray_distances, viewing_rays
from poseppl.motion.io import DetectedPeople

LARGEST_DISTANCE, LARGEST_DISTANCE_ALONE = 120.0, 300.0
"""Median distance (mm) between the rays of two detections of one person, at most; and where no camera finds a second person, so
that cameras whose errors are as large as their refinement's prior are kept."""
LARGEST_SPEED, LARGEST_JUMP = 10_000.0, 300.0
"""A person's middle moves by at most this many mm a second, and this many mm by errors."""
LONGEST_ABSENCE = 1.0
"""Seconds for which a person may be found by no two cameras."""
MIN_PRESENCE = 0.25
"""Share of the frames in which two cameras see someone, at least, who counts as one of the people of a scene; ours."""
_CONFIDENT = 0.3
"""Points of less confidence do not tell who is who."""
_MIN_COMMON = 4
_NOMINAL_EXTENT = 1500.0
"""Height (mm) of what a detector finds of a person, from which one camera tells a distance."""


class Group(NamedTuple):
    """Detections of one person in one frame.

    Attributes:
        chosen: Index of the detection in each camera, -1 where there is none.
        place: Roughly where the person is, mm.
        support: Confidence of all its points.
    """

    chosen: tuple[int, ...]
    place: Floats
    support: float


class FollowedPerson:
    """One person, followed from frame to frame without those that come later.

    The person is whom two cameras see nearest to the last place, in reach of it; after a second, who is seen best.

    Args:
        cameras: C cameras.
        people: Detections of each camera in the same T frames.
        chosen: (T, C) which of the detections are the person's, -1 where there is none; some are.
        rate: Frames a second.
    """

    def __init__(self, cameras: Cameras, people: Sequence[DetectedPeople], chosen: Integers, rate: float) -> None:
        self._cameras, self._rate = jax.tree.map(np.asarray, cameras), rate
        self._scale = _NOMINAL_EXTENT / _extent(people[0])
        last = int(np.flatnonzero((chosen >= 0).any(1))[-1])
        alone, rays = _one_frame(cameras, people, last)
        own = {c: int(p) for c, p in enumerate(chosen[last]) if p >= 0}
        if len(people) == 1:
            self._place = _group_of_one(alone[0], 0, own[0], self._scale).place
        else:
            self._place = _group(np.asarray(cameras.centre, np.float64), alone, rays, 0, own).place
        self._absent = len(chosen) - last

    def choose(self, people: Sequence[DetectedPeople]) -> Integers:
        """The person's detections in the next T frames: (T, C) indices, -1 where there is none."""
        frames = (_one_frame(self._cameras, people, t) for t in range(len(people[0].points)))
        return np.array([self._next(_groups(self._cameras, *frame, 0, self._scale)) for frame in frames])

    def _next(self, groups: Sequence[Group]) -> tuple[int, ...]:
        seconds = self._absent / self._rate
        self._absent += 1
        if seconds > LONGEST_ABSENCE:
            found = max(groups, key=lambda group: group.support, default=None)
        else:
            reach = LARGEST_JUMP + LARGEST_SPEED * seconds
            near = [(float(np.linalg.norm(group.place - self._place)), number) for number, group in enumerate(groups)]
            found = groups[min(near)[1]] if near and min(near)[0] <= reach else None
        if found is None:
            return (-1,) * len(self._cameras.centre)
        self._place, self._absent = found.place, 1
        return found.chosen


def associate_person(
    cameras: Cameras,
    people: Sequence[DetectedPeople],
    rate: float,
    person: int = 1,
    *,
    largest_alone: float = LARGEST_DISTANCE_ALONE,
) -> Integers:
    """Find one person's detections.

    Args:
        cameras: C cameras.
        people: Detections of each camera in the same T frames.
        rate: Frames a second.
        person: 1 for the person who is seen best, 2 for the next.
        largest_alone: Median distance (mm) of rays, at most, in frames where no camera finds a second person.

    Returns:
        (T, C) index of the person's detection in each camera, -1 where there is none.

    Raises:
        InputError: There are fewer people.
    """
    found = list(islice(associate_people(cameras, people, rate, largest_alone=largest_alone), person))
    if len(found) < person:
        seen = f"{len(found)} people are seen" if found else "nobody is seen"
        problem = f"{seen} by two cameras whose rays agree" if len(people) > 1 else seen
        expected = "person 1, cameras of one calibration, and common frames"
        raise InputError(problem, field=Argument("person"), expected=expected)
    return found[-1]


def associate_people(
    cameras: Cameras, people: Sequence[DetectedPeople], rate: float, *, largest_alone: float = LARGEST_DISTANCE_ALONE
) -> Iterator[Integers]:
    """Find the detections (T, C) of one person after the other, who is seen best first; no detection is of two people.

    Arguments are those of :func:`associate_person`.
    """
    rays = [viewing_rays(cameras, index, _confident(found)) for index, found in enumerate(people)]
    scale = _NOMINAL_EXTENT / _extent(people[0])
    frames = [_groups(cameras, people, rays, frame, scale, largest_alone) for frame in range(len(people[0].points))]
    while path := _best_path(frames, rate):
        chosen = np.full((len(frames), len(people)), -1)
        for frame, index in path.items():
            chosen[frame] = frames[frame][index].chosen
        yield chosen
        frames = [[g for i, g in enumerate(groups) if path.get(frame) != i] for frame, groups in enumerate(frames)]


def num_people(found: Iterable[Integers], most: int) -> int:
    """How many people, at most ``most``, two cameras or more see in :data:`MIN_PRESENCE` of the frames.

    Args:
        found: Their detections (T, C), as :func:`associate_people` finds them.
        most: Largest number; the search ends there.
    """
    present = (((chosen >= 0).sum(1) > 1).mean() >= MIN_PRESENCE for chosen in islice(found, most))
    return len(list(takewhile(bool, present)))


def _confident(found: DetectedPeople) -> Floats:
    return np.where((found.confidence >= _CONFIDENT)[..., None], found.points, np.nan)


def _one_frame(cameras: Cameras, people: Sequence[DetectedPeople], frame: int) -> tuple[list[DetectedPeople], list[Floats]]:
    """One frame of several, and its rays."""
    alone = [found._replace(points=found.points[[frame]], confidence=found.confidence[[frame]]) for found in people]
    return alone, [viewing_rays(cameras, index, _confident(found)) for index, found in enumerate(alone)]


def _groups(
    cameras: Cameras,
    people: Sequence[DetectedPeople],
    rays: Sequence[Floats],
    frame: int,
    scale: float,
    largest_alone: float = LARGEST_DISTANCE_ALONE,
) -> list[Group]:
    """The people of a frame; in one camera alone their places follow from so many mm a pixel."""
    detections = [(c, p) for c, found in enumerate(rays) for p in range(found.shape[1]) if np.isfinite(found[frame, p]).any()]
    if len(people) == 1:
        return [_group_of_one(people[0], frame, p, scale) for _, p in detections]
    centres = np.asarray(cameras.centre, np.float64)
    alone = len({camera for camera, _ in detections}) == len(detections)
    largest = largest_alone if alone else LARGEST_DISTANCE
    distances = _distances(centres, [(detection, rays[detection[0]][frame, detection[1]]) for detection in detections])
    member = {detection: {detection} for detection in detections}
    for pair, near in sorted(distances.items(), key=lambda item: item[1]):
        first, second = (member[detection] for detection in pair)
        if near > largest or first is second:
            continue
        if all(distances.get(frozenset([a, b]), np.inf) <= largest for a in first for b in second):
            first |= second
            for detection in second:
                member[detection] = first
    joined = {id(group): group for group in member.values() if len(group) > 1}
    return [_group(centres, people, rays, frame, dict(sorted(group))) for group in joined.values()]


def _distances(
    centres: Floats, detections: Sequence[tuple[tuple[int, int], Floats]]
) -> dict[frozenset[tuple[int, int]], float]:
    """Median distances between the rays of detections, (camera, number) and (K, 3), in two cameras; infinite of few points."""
    pairs = [pair for pair in combinations(detections, 2) if pair[0][0][0] != pair[1][0][0]]
    if not pairs:
        return {}
    first, second = (np.stack([pair[end][1] for pair in pairs]) for end in (0, 1))
    here, there = (centres[[pair[end][0][0] for pair in pairs]] for end in (0, 1))
    apart = np.sort(ray_distances(here, first, there, second))  # NaN are last
    common = np.isfinite(apart).sum(-1)
    rows = np.arange(len(pairs))
    middle = (apart[rows, np.maximum(common - 1, 0) // 2] + apart[rows, common // 2 % apart.shape[1]]) / 2
    near = np.where(common >= _MIN_COMMON, middle, np.inf)
    return {frozenset([a[0], b[0]]): float(value) for (a, b), value in zip(pairs, near, strict=True)}


def _extent(found: DetectedPeople) -> float:
    """Median height or width, whichever is larger, of all detections, px."""
    seen = np.isfinite(found.points).all(-1).any(-1)
    points = found.points[seen]
    if not len(points):
        return 1.0
    return max(float(np.median((np.nanmax(points, 1) - np.nanmin(points, 1)).max(-1))), 1.0)


def _group_of_one(found: DetectedPeople, frame: int, index: int, scale: float) -> Group:
    """A detection in the only camera, whose place is that in the picture at so many mm a pixel."""
    place = np.nanmean(found.points[frame, index], 0) * scale
    return Group((index,), np.append(place, 0.0), float(found.confidence[frame, index].sum()))


def _group(
    centres: Floats, people: Sequence[DetectedPeople], rays: Sequence[Floats], frame: int, chosen: dict[int, int]
) -> Group:
    seen = np.stack([rays[c][frame, p] for c, p in chosen.items()])
    places = nearest_points(centres[list(chosen)], seen, np.isfinite(seen).all(-1).astype(float))
    support = sum(float(people[c].confidence[frame, p].sum()) for c, p in chosen.items())
    return Group(
        tuple(chosen.get(c, -1) for c in range(len(people))), np.median(places[np.isfinite(places).all(-1)], 0), support
    )


def _best_path(frames: Sequence[Sequence[Group]], rate: float) -> dict[int, int]:
    """Which group of each frame lies on the path of most support."""
    nodes = [(t, i) for t, groups in enumerate(frames) for i in range(len(groups))]
    if not nodes:
        return {}
    times = np.array([t for t, _ in nodes]) / rate
    places = np.stack([frames[t][i].place for t, i in nodes])
    support = np.array([frames[t][i].support for t, i in nodes])
    total, before = support.copy(), np.full(len(nodes), -1)
    first = 0
    for node in range(len(nodes)):
        while times[node] - times[first] > LONGEST_ABSENCE + 1 / rate:
            first += 1
        gap = times[node] - times[first:node]
        reach = LARGEST_JUMP + LARGEST_SPEED * gap
        ratio = np.linalg.norm(places[first:node] - places[node], axis=-1) / reach
        gains = np.where((gap > 0) & (ratio <= 1), total[first:node] - ratio, -np.inf)
        if gains.size and gains.max() > 0:
            before[node] = first + int(gains.argmax())
            total[node] += gains.max()
    path, node = {}, int(total.argmax())
    while node >= 0:
        path[nodes[node][0]] = nodes[node][1]
        node = int(before[node])
    return path
