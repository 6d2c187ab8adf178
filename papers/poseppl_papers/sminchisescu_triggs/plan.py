"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from poseppl.errors import InputError
from poseppl.motion.io import read_motion
from poseppl_papers.experiment import Task
from poseppl_papers.recordings import BUILT_IN, Recording
from poseppl_papers.sminchisescu_triggs.images import Pictures, track_pictures
from poseppl_papers.sminchisescu_triggs.motions import BEGIN, MOTIONS
from poseppl_papers.sminchisescu_triggs.one_picture import OnePicture, measure_people
from poseppl_papers.sminchisescu_triggs.spectra import plan_of, spectra
from poseppl_papers.sminchisescu_triggs.trackers import JUMPS, OURS, OURS_LIMITED, PUBLISHED, TRACKERS
from poseppl_papers.sminchisescu_triggs.tracks import Tracks, track


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each tracker on each scene; on complex motions, runs of all motions together.
        more_runs: The same of trackers of which `runs` had left a verdict open, at the first rate.
        rates: Frames a second.
        arm_seconds: How long the arm is seen.
        body_seconds: How long the pivoting body is seen.
        complex_seconds: How long a complex motion is seen.
        reflected_seconds: How long a motion through ambiguous poses is seen, or a stretch of a recording.
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
    reflected_seconds: float = 2.0
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
    reflected_seconds=0.4,
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
    "reflections": (
        PUBLISHED,
        *_SINGLE,
        "without non-penetration",
        "MHT, robust, large noise",
        "CONDENSATION, large noise",
        "MHT, Gaussian, unconstrained, large noise",
        _UNLIMITED,
        JUMPS,
        "CONDENSATION",
        OURS_LIMITED,
    ),
}
"""Trackers of a scene: those that the paper compares there, its own tracker with parts left out, and ours."""
_OPEN: Mapping[str, tuple[str, ...]] = {"complex": ("Gaussian, single mode", PUBLISHED)}
"""Trackers with more runs."""
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


def plan_reflections(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Limbs that swing along the optical axis: our own motions, and those recorded, as many runs of each."""
    motions = [(name, BUILT_IN) for name in MOTIONS] + [("recorded", each) for each in recordings if each != BUILT_IN]
    times = max(1, round(scale.runs / len(motions)))
    seconds, rate = scale.reflected_seconds, scale.rates[0]
    jobs = [
        Tracks(scene, "stiff_shoulders", recording, rate, seconds, False, tracker, seeds, apart=True, along=True)
        for tracker in _RIVALS["reflections"]
        if tracker in scale.trackers
        for number, (scene, recording) in enumerate(motions)
        for seeds in [tuple(range(number, times * len(motions), len(motions)))]
    ]
    return {"tracks": Task(track, jobs)}


def plan_clavicles(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Stretches of recorded motions followed by a body with clavicles, and by one without."""
    motions = [each for each in recordings if each != BUILT_IN]
    if not motions:
        raise InputError("clavicles are seen in recorded motions; give some by --motion NAME=FILE,SKELETON")
    seconds = scale.reflected_seconds
    stretches = [(motion, begin) for motion in motions for begin in _beginnings(motion, seconds)]
    if not stretches:
        raise InputError(f"no recording lasts {BEGIN + seconds:g} s", field="--motion", expected="a longer one")
    jobs = [
        Tracks("recorded", kind, motion, scale.rates[0], seconds, False, PUBLISHED, (number,), begin=begin)
        for kind in ("full", "stiff_shoulders")
        for number, (motion, begin) in enumerate(stretches[:: max(1, len(stretches) // scale.runs)])
    ]
    return {"tracks": Task(track, jobs)}


def _beginnings(recording: Recording, seconds: float) -> list[float]:
    """Seconds at which stretches of a recording begin, one after the other."""
    assert recording.path is not None
    motion = read_motion(recording.path, recording.skeleton)
    count = int((len(motion.positions) / motion.rate - BEGIN) / seconds)
    return [BEGIN + number * seconds for number in range(count)]


def plan_spectra(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """How uncertain poses are along each direction."""
    return {"spectra": Task(spectra, plan_of(range(scale.runs)))}


def plan_sizes(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """People measured in one picture each."""
    return {"sizes": Task(measure_people, [OnePicture(tuple(range(scale.runs)))])}


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
                    known = (scene, kind, recording, rate, seconds, cluttered, tracker, seeds)
                    jobs += [Tracks(*known, apart=kind == "arm")] if seeds else []
    return {"tracks": Task(track, jobs)}


def plan_pictures(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """A rendered arm, against black and in a cluttered room."""
    jobs = [
        Pictures(scale.rates[0], scale.picture_seconds, cluttered, tracker, tuple(range(scale.picture_runs)))
        for cluttered in (False, True)
        for tracker in _MAX_SEEN
    ]
    return {"pictures": Task(track_pictures, jobs)}
