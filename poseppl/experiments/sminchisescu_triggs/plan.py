"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from poseppl.experiments.experiment import Task
from poseppl.experiments.recordings import BUILT_IN, Recording
from poseppl.experiments.sminchisescu_triggs.images import Pictures, track_pictures
from poseppl.experiments.sminchisescu_triggs.trackers import OURS, PUBLISHED, TRACKERS
from poseppl.experiments.sminchisescu_triggs.tracks import Tracks, track


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Of each tracker on each scene; on complex motions of all motions together.
        rates: Frames a second.
        arm_seconds: How long the arm is seen.
        body_seconds: How long the pivoting body is seen.
        complex_seconds: How long a complex motion is seen.
        trackers: Names of the trackers that take part, of those of a scene.
        picture_runs: Runs of each tracker on rendered frames.
        picture_seconds: How long a rendered arm is seen.
    """

    runs: int = 12
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
    rates=(25.0,),
    arm_seconds=0.8,
    body_seconds=0.4,
    complex_seconds=0.4,
    trackers=("Gaussian, single mode", "covariance scaled"),
    picture_runs=1,
    picture_seconds=0.2,
)
_SINGLE = ("Gaussian, single mode", "robust, single mode")
_RIVALS: Mapping[str, tuple[str, ...]] = {
    "arm": (PUBLISHED, *_SINGLE, "without joint limits", "covariance scaled, twice as many", OURS),
    "pivot": (
        *_SINGLE,
        PUBLISHED,
        "MHT, robust",
        "MHT, Gaussian, unconstrained",
        "covariance scaled, twice as many",
        "with non-penetration",
        OURS,
    ),
    "complex": (*_SINGLE, PUBLISHED, "without joint limits", "with non-penetration", OURS),
}
"""Who is compared on a scene: those that the paper compares there, what it leaves out of its own tracker, and ours."""
_MOST_SEEN = ("robust, single mode", PUBLISHED)
"""Trackers at all rates, the others being at the first alone, and on pictures."""


def plan_arm(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """An arm that bends and rotates in a cluttered room."""
    own = {("arm", BUILT_IN): tuple(range(scale.runs))}
    return _tracks(scale, "arm", "arm", own, scale.arm_seconds, cluttered=True)


def plan_pivot(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """A body that pivots in a cluttered room."""
    own = {("pivot", BUILT_IN): tuple(range(scale.runs))}
    return _tracks(scale, "pivot", "stiff_shoulders", own, scale.body_seconds, cluttered=True)


def plan_complex(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Complex motions against black: those recorded, and our own."""
    motions = [("recorded", each) for each in recordings if each != BUILT_IN] + [("turns", BUILT_IN)]
    shared = {each: tuple(range(number, scale.runs, len(motions))) for number, each in enumerate(motions)}
    return _tracks(scale, "complex", "full", shared, scale.complex_seconds, cluttered=False)


Shared = Mapping[tuple[str, Recording], tuple[int, ...]]
"""Seeds of scenes and recordings."""


def _tracks(scale: Scale, part: str, kind: str, shared: Shared, seconds: float, *, cluttered: bool) -> dict[str, Task]:
    jobs = [
        Tracks(scene, kind, recording, rate, seconds, cluttered, tracker, seeds)
        for tracker in _RIVALS[part]
        if tracker in scale.trackers
        for rate in (scale.rates if tracker in _MOST_SEEN else scale.rates[:1])
        for (scene, recording), seeds in shared.items()
        if seeds
    ]
    return {"tracks": Task(track, jobs)}


def plan_pictures(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """A rendered arm, against black and in a cluttered room."""
    jobs = [
        Pictures(scale.rates[0], scale.picture_seconds, cluttered, tracker, tuple(range(scale.picture_runs)))
        for cluttered in (False, True)
        for tracker in _MOST_SEEN
    ]
    return {"pictures": Task(track_pictures, jobs)}
