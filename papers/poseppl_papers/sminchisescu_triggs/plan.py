"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from poseppl_papers.experiment import Task
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.sminchisescu_triggs.images import Pictures, track_pictures
from poseppl_papers.sminchisescu_triggs.trackers import OURS, OURS_LIMITED, PUBLISHED, TRACKERS
from poseppl_papers.sminchisescu_triggs.tracks import Tracks, track


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Of each tracker on each scene; on complex motions of all motions together.
        more_runs: The same of trackers of which `runs` had left a verdict open, at the first rate.
        rates: Frames a second.
        arm_seconds: How long the arm is seen.
        body_seconds: How long the pivoting body is seen.
        complex_seconds: How long a complex motion is seen.
        trackers: Names of the trackers that take part, of those of a scene.
        picture_runs: Runs of each tracker on rendered frames.
        picture_seconds: How long a rendered arm is seen.
    """

    runs: int = 12
    more_runs: int = 36
    rates: tuple[float, ...] = (25.0, 50.0)
    arm_seconds: float = 8.0
    body_seconds: float = 1.2
    complex_seconds: float = 4.0
    trackers: tuple[str, ...] = tuple(TRACKERS)
    picture_runs: int = 10
    picture_seconds: float = 8.0


FULL = Scale()
QUICK = Scale(
    runs=2,
    more_runs=2,
    rates=(25.0,),
    arm_seconds=0.8,
    body_seconds=0.4,
    complex_seconds=0.4,
    trackers=("Gaussian, single mode", "covariance scaled"),
    picture_runs=1,
    picture_seconds=0.2,
)
_SINGLE = ("Gaussian, single mode", "robust, single mode")
_WHOLE, _TWICE, _UNLIMITED = "with non-penetration", "covariance scaled, twice as many", "without joint limits"
_RIVALS: Mapping[str, tuple[str, ...]] = {
    "arm": (PUBLISHED, *_SINGLE, _UNLIMITED, "without non-penetration", _TWICE, OURS, OURS_LIMITED),
    "pivot": (*_SINGLE, PUBLISHED, "MHT, robust", "MHT, Gaussian, unconstrained", _TWICE, _WHOLE, OURS),
    "complex": (*_SINGLE, PUBLISHED, _UNLIMITED, _WHOLE, OURS, OURS_LIMITED),
}
"""Who is compared on a scene: those that the paper compares there, what it leaves out of its own tracker, and ours."""
_OPEN: Mapping[str, tuple[str, ...]] = {"complex": ("Gaussian, single mode", PUBLISHED)}
"""Of which there are more runs."""
_MAX_SEEN = ("robust, single mode", PUBLISHED)
"""Trackers at all rates, the others being at the first alone, and on pictures."""


def plan_arm(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """An arm that bends and rotates in a cluttered room."""
    return _tracks(scale, "arm", "arm", [("arm", BUILT_IN)], scale.arm_seconds, cluttered=True)


def plan_pivot(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """A body that pivots in a cluttered room."""
    return _tracks(scale, "pivot", "stiff_shoulders", [("pivot", BUILT_IN)], scale.body_seconds, cluttered=True)


def plan_complex(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Complex motions against black: those recorded, and our own."""
    motions = [("recorded", each) for each in recordings if each != BUILT_IN] + [("turns", BUILT_IN)]
    return _tracks(scale, "complex", "full", motions, scale.complex_seconds, cluttered=False)


Motions = Sequence[tuple[str, Recording]]
"""Scenes and recordings."""


def _tracks(scale: Scale, part: str, kind: str, motions: Motions, seconds: float, *, cluttered: bool) -> dict[str, Task]:
    """Jobs; runs are dealt out to the motions."""
    jobs = []
    for tracker in [each for each in _RIVALS[part] if each in scale.trackers]:
        for rate in scale.rates if tracker in _MAX_SEEN else scale.rates[:1]:
            more = tracker in _OPEN.get(part, ()) and rate == scale.rates[0]
            for runs in (range(scale.runs), range(scale.runs, scale.more_runs if more else 0)):
                for number, (scene, recording) in enumerate(motions):
                    seeds = tuple(run for run in runs if run % len(motions) == number)
                    jobs += [Tracks(scene, kind, recording, rate, seconds, cluttered, tracker, seeds)] if seeds else []
    return {"tracks": Task(track, jobs)}


def plan_pictures(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """A rendered arm, against black and in a cluttered room."""
    jobs = [
        Pictures(scale.rates[0], scale.picture_seconds, cluttered, tracker, tuple(range(scale.picture_runs)))
        for cluttered in (False, True)
        for tracker in _MAX_SEEN
    ]
    return {"pictures": Task(track_pictures, jobs)}
