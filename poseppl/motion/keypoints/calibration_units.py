"""The unit of a calibration that does not tell it, from the size of the person that its cameras see.

Rays of one person's points meet at places whose distances have the unit of the cameras' places. In each frame and pair of
cameras, the two detections are taken whose rays pass nearest to each other for the size of what they see; the person's
segments, over those of a body of 1.75 m, tell how many mm a unit has. People differ by a factor of two, units by ten.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from poseppl.arrays import Floats
from poseppl.errors import Argument, InputError
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.cameras import nearest_points, ray_distances, viewing_rays
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import scaled
from poseppl.motion.io.units_and_axes import MM_PER_UNIT
from poseppl.motion.tracking.placing import cameras_of_records

STATURE = 1.75
"""Metres, of the body that the segments below are of."""
_SEGMENTS = {("hip", "knee"): 430.0, ("knee", "ankle"): 420.0, ("shoulder", "elbow"): 300.0, ("elbow", "wrist"): 260.0}
_UNITS = ("mm", "cm", "m")
LARGEST_FACTOR = 2.0
"""People are at most so many times as large, or as small, as a body of 1.75 m."""
_MAX_FRAMES, _MIN_SEGMENTS = 60, 20
_CONFIDENT = 0.3


class Unit(NamedTuple):
    """A unit of length.

    Attributes:
        name: mm, cm or m.
        stature: Metres of the person's height in it, roughly.
    """

    name: str
    stature: float


def infer_unit(
    records: Sequence[CameraRecord], people: Sequence[DetectedPeople], markers: Mapping[str, int]
) -> tuple[list[CameraRecord], Unit]:
    """Find the unit of cameras whose lengths were taken for metres.

    Args:
        records: C cameras.
        people: Detections of each camera in common frames.
        markers: The points' numbers by the names of a body's markers.

    Returns:
        The cameras in mm, and their unit.

    Raises:
        InputError: Too little is seen to tell, or no unit makes a person of it.
    """
    cameras = cameras_of_records(records)
    ratios = np.array([ratio for pair in meeting_rays(cameras, people) for ratio in segment_ratios(pair.places, markers)])
    if len(ratios) < _MIN_SEGMENTS:
        raise InputError(
            "the calibration does not state its unit of length, and two cameras see too little of a person to estimate it",
            field=Argument("unit"),
            expected=", ".join(_UNITS),
        )
    middle = float(np.median(ratios))
    name = min(_UNITS, key=lambda unit: abs(np.log(middle * MM_PER_UNIT[unit] / MM_PER_UNIT["m"])))
    stature = STATURE * middle * MM_PER_UNIT[name] / MM_PER_UNIT["m"]
    if not 1 / LARGEST_FACTOR <= stature / STATURE <= LARGEST_FACTOR:
        raise InputError(
            f"the calibration does not state its unit of length, and in {name} the person would be {stature:.2g} m tall",
            field=Argument("unit"),
            expected=f"{', '.join(_UNITS)}, or how many mm it has, perhaps {1000 / middle:.3g}",
        )
    return [scaled(record, MM_PER_UNIT[name] / MM_PER_UNIT["m"]) for record in records], Unit(name, stature)


class MeetingRays(NamedTuple):
    """Two detections, in two cameras and one frame, whose rays pass nearest to each other.

    Attributes:
        cameras: Numbers of the two.
        apart: Median distance at which they pass, over the size of what they see.
        places: (K, 3) where they do, in the unit of the cameras' places; NaN where a point is not seen by both.
    """

    cameras: tuple[int, int]
    apart: float
    places: Floats


def meeting_rays(cameras: Cameras, people: Sequence[DetectedPeople]) -> list[MeetingRays]:
    """The nearest two detections of each pair of cameras, in at most 60 frames.

    Args:
        cameras: C cameras.
        people: Detections of each camera in common frames.
    """
    centres = np.asarray(cameras.centre, np.float64)
    rows = np.unique(np.linspace(0, len(people[0].points) - 1, min(_MAX_FRAMES, len(people[0].points))).astype(int))
    rays = []
    for c, found in enumerate(people):
        sure = (found.confidence[rows] >= _CONFIDENT)[..., None]
        rays.append(viewing_rays(cameras, c, np.where(sure, found.points[rows], np.nan)))
    nearest = []
    for a, b in combinations(range(len(people)), 2):
        for row in range(len(rows)):
            pairs = [_pair(centres, (a, b), np.stack([one, other])) for one in rays[a][row] for other in rays[b][row]]
            known = [pair for pair in pairs if pair is not None]
            if known:
                nearest.append(min(known, key=lambda pair: pair.apart))
    return nearest


def _pair(centres: Floats, cameras: tuple[int, int], rays: Floats) -> MeetingRays | None:
    """Distances at which rays (2, K, 3) of two cameras pass each other; None if both cameras see fewer than four points."""
    seen = np.isfinite(rays).all((0, 2))
    if seen.sum() < 4:
        return None
    places = np.full((rays.shape[1], 3), np.nan)
    first, second = cameras
    places[seen] = nearest_points(centres[[first, second]], rays[:, seen], np.ones((2, int(seen.sum()))))
    apart = ray_distances(centres[first], rays[0, seen], centres[second], rays[1, seen])
    size = float(np.median(np.linalg.norm(places[seen] - np.median(places[seen], 0), axis=-1)))
    return MeetingRays(cameras, float(np.median(apart)) / max(size, 1e-12), places)


def segment_ratios(places: Floats, markers: Mapping[str, int]) -> list[float]:
    """Lengths of the segments between places (K, 3), in mm, over those of a body of 1.75 m; those that are known."""
    found = []
    for (upper, lower), length in _SEGMENTS.items():
        for side in "lr":
            ends = [markers.get(f"{name}_{side}") for name in (upper, lower)]
            if None not in ends:
                measured = float(np.linalg.norm(places[ends[0]] - places[ends[1]]))
                found += [measured / length] if np.isfinite(measured) else []
    return found
