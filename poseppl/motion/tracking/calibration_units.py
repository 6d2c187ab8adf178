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
from poseppl.errors import InputError
from poseppl.motion.geometry import Cameras
from poseppl.motion.geometry.triangulation import nearest_points, ray_distances, viewing_rays
from poseppl.motion.io import CameraRecord, DetectedPeople
from poseppl.motion.io.camera_fields import scaled
from poseppl.motion.io.length_units import MM_PER_UNIT
from poseppl.motion.tracking.placing import cameras_of_records

STATURE = 1.75
"""Metres, of the body that the segments below are of."""
_SEGMENTS = {("hip", "knee"): 430.0, ("knee", "ankle"): 420.0, ("shoulder", "elbow"): 300.0, ("elbow", "wrist"): 260.0}
_UNITS = ("mm", "cm", "m")
LARGEST_FACTOR = 2.0
"""People are at most so many times as large, or as small, as a body of 1.75 m."""
_MOST_FRAMES, _LEAST_SEGMENTS = 60, 20
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
        people: What each saw, in common frames.
        markers: The points' numbers by the names of a body's markers.

    Returns:
        The cameras in mm, and their unit.

    Raises:
        InputError: Too little is seen to tell, or no unit makes a person of it.
    """
    cameras = cameras_of_records(records)
    ratios = _segment_ratios(cameras, people, markers)
    if len(ratios) < _LEAST_SEGMENTS:
        raise InputError(
            "the calibration does not tell its unit of length, and too little of a person is seen by two cameras to tell it",
            field="--unit",
            expected=", ".join(_UNITS),
        )
    middle = float(np.median(ratios))
    name = min(_UNITS, key=lambda unit: abs(np.log(middle * MM_PER_UNIT[unit] / MM_PER_UNIT["m"])))
    stature = STATURE * middle * MM_PER_UNIT[name] / MM_PER_UNIT["m"]
    if not 1 / LARGEST_FACTOR <= stature / STATURE <= LARGEST_FACTOR:
        raise InputError(
            f"the calibration does not tell its unit of length, and in {name} the person would be {stature:.2g} m tall",
            field="--unit",
            expected=f"{', '.join(_UNITS)}, or how many mm it has, perhaps {1000 / middle:.3g}",
        )
    return [scaled(record, MM_PER_UNIT[name] / MM_PER_UNIT["m"]) for record in records], Unit(name, stature)


def _segment_ratios(cameras: Cameras, people: Sequence[DetectedPeople], markers: Mapping[str, int]) -> Floats:
    """Lengths of segments over those of a body of 1.75 m, as pairs of cameras see them."""
    centres = np.asarray(cameras.centre, np.float64)
    rows = np.unique(np.linspace(0, len(people[0].points) - 1, min(_MOST_FRAMES, len(people[0].points))).astype(int))
    rays = []
    for c, found in enumerate(people):
        sure = (found.confidence[rows] >= _CONFIDENT)[..., None]
        rays.append(viewing_rays(cameras, c, np.where(sure, found.points[rows], np.nan)))
    ratios: list[float] = []
    for a, b in combinations(range(len(people)), 2):
        for row in range(len(rows)):
            best = None
            for first in rays[a][row]:
                for second in rays[b][row]:
                    pair = _pair(centres[[a, b]], np.stack([first, second]))
                    if pair is not None and (best is None or pair[0] < best[0]):
                        best = pair
            if best is not None:
                ratios += segment_ratios(best[1], markers)
    return np.array(ratios)


def _pair(centres: Floats, rays: Floats) -> tuple[float, Floats] | None:
    """How far rays (2, K, 3) pass from each other, as a share of the size of what they see, and their places (K, 3)."""
    seen = np.isfinite(rays).all((0, 2))
    if seen.sum() < 4:
        return None
    places = np.full((rays.shape[1], 3), np.nan)
    places[seen] = nearest_points(centres, rays[:, seen], np.ones((2, int(seen.sum()))))
    apart = ray_distances(centres[0], rays[0, seen], centres[1], rays[1, seen])
    size = float(np.median(np.linalg.norm(places[seen] - np.median(places[seen], 0), axis=-1)))
    return float(np.median(apart)) / max(size, 1e-12), places


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
