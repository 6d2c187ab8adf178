"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from poseppl_papers.darby.people import Taught, first_of_each, known, track_taught, unknown
from poseppl_papers.experiment import Task
from poseppl_papers.images.scenes import Rendering, Scene, render
from poseppl_papers.images.systems import LIMBS, Method, System
from poseppl_papers.images.tracking import tracking_tasks
from poseppl_papers.recordings import Recording

_BUILDER = "poseppl_models.images.image_systems:darby_system"
STANDARD = System("darby, Eq. 8", _BUILDER, 4)
STANDARD_ALONE = System("darby, Eq. 8", _BUILDER, 1)
"""The standard weight with one camera."""
MODIFIED = System("darby, Eq. 9", _BUILDER, 1, (("equation", 9),))
"""The paper's weight for one camera."""
LAYERS = 5
_LEARNED = "poseppl_models.darby.learned_system:darby_learned_system"
WALKING = System("standard, two cameras", _LEARNED, 2, (("guided", False),))
KNOWN = System("guided, known, two cameras", _LEARNED, 2)
UNKNOWN = System("guided, unknown, two cameras", _LEARNED, 2)
WALKING_ALONE = System("standard, one camera", _LEARNED, 1, (("guided", False),))
SITTING = System("guided, known, gamma = 0", _LEARNED, 1, (("equation", 9), ("gamma", 0.0)))
AGREEING = System("guided, known, gamma = 5", _LEARNED, 1, (("equation", 9), ("gamma", 5.0)))
TEMPERATURE = 0.6
"""rho_T."""


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each filter.
        num_frames: How many are tracked.
        scene_frames: Frames of the scene, whose largest changes between frames are the diffusion.
        size: Width and height of the images, px.
        particles: Each number of particles a layer.
        tracked: How many recordings of a person are tracked where the motion is learned.
        walk: How many frames of each.
        rate: Frames a second of these.
        known: Frames that the motion of a known person is learned from, at most.
        unknown: Frames of each of three others, at most.
        rounds: Largest number of rounds of Baum-Welch.
    """

    runs: int = 10
    num_frames: int = 30
    scene_frames: int = 40
    size: tuple[int, int] = (640, 480)
    particles: tuple[int, ...] = (40, 100, 200, 500, 1000)
    tracked: int = 2
    walk: int = 150
    rate: float = 60.0
    known: int = 1900
    unknown: int = 700
    rounds: int = 50


FULL = Scale()
QUICK = Scale(
    2, num_frames=5, scene_frames=5, size=(320, 240), particles=(20, 100), tracked=1, walk=5, known=300, unknown=200, rounds=2
)


def annealed(num_particles: int) -> Method:
    """The paper's annealed filter, so many particles in each layer."""
    settings = (("crossover", LIMBS), ("num_layers", LAYERS), ("num_particles", num_particles))
    return Method(f"APF, {LAYERS} x {num_particles:,}", "annealed", settings)


def plan_trackers(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The annealed filter with four cameras."""
    return _tasks(scale, recordings[0], (STANDARD,))


def plan_one_camera(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The same with one, under both weights."""
    return _tasks(scale, recordings[0], (STANDARD_ALONE, MODIFIED))


def _tasks(scale: Scale, recording: Recording, systems: Sequence[System]) -> dict[str, Task]:
    scene = Scene(recording, False, scale.scene_frames, width=scale.size[0], height=scale.size[1])
    rivals = [(system, annealed(number)) for system in systems for number in scale.particles]
    return tracking_tasks([scene], rivals, scale.num_frames, scale.runs)


def guided(num_particles: int) -> Method:
    """The paper's guided filter, so many particles in each layer."""
    settings = (*annealed(num_particles).settings, ("temperature", TEMPERATURE))
    return Method(f"HMM-APF, {LAYERS} x {num_particles:,}", "activity-guided", settings)


def plan_guided(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The guided filter of known and unknown people, and the standard one, with two cameras."""
    return _taught_tasks(scale, recordings, WALKING, (KNOWN,), (UNKNOWN,))


def plan_guided_alone(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """The guided filter of known people, with and without the silhouette's size in the weight, and the standard one."""
    return _taught_tasks(scale, recordings, WALKING_ALONE, (SITTING, AGREEING), ())


def _taught_tasks(
    scale: Scale, recordings: Sequence[Recording], standard: System, of_known: Sequence[System], of_unknown: Sequence[System]
) -> dict[str, Task]:
    """Each person's first recordings are tracked; what is learned for the standard filter is that of an unknown person."""
    jobs: list[Taught] = []
    scenes: list[Scene] = []
    for tracked in first_of_each(recordings, scale.tracked):
        scene = Scene(tracked, False, scale.walk, scale.rate, *scale.size)
        own = known(tracked, recordings, scale.known, scale.rate, scale.rounds)
        others = unknown(tracked, recordings, scale.unknown, scale.rate, scale.rounds)
        few, many = scale.particles[0], scale.particles[len(scale.particles) // 2]
        rivals = [(standard, annealed(number), others) for number in (few, many)]
        rivals += [(system, guided(few), own) for system in of_known if own is not None]
        rivals += [(system, guided(few), others) for system in of_unknown]
        scenes.append(scene)
        runs = tuple(range(scale.runs))
        jobs += [Taught(scene, system, scale.walk, method, runs, training=training) for system, method, training in rivals]
    return {"scenes": Task(render, [Rendering(scene) for scene in scenes]), "tracking": Task(track_taught, jobs)}
