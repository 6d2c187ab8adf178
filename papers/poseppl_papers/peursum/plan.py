"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from poseppl_papers.experiment import Task
from poseppl_papers.images.scenes import Rendering, Scene, render
from poseppl_papers.images.systems import Method, System
from poseppl_papers.images.tracking import tracking_tasks
from poseppl_papers.peursum.dimensionality import EXACT, FBS, SMOOTHERS, GrowthRuns, smooth_growth
from poseppl_papers.peursum.mixtures import FILTER, SMOOTHERS as MIXTURE_SMOOTHERS, MixtureRun, smooth_mixture
from poseppl_papers.peursum.monocular import AnimatedScene, SmoothedAnimation, smooth_animation
from poseppl_papers.peursum.scenes import circle_scenes, clutter_scenes
from poseppl_papers.peursum.smoothed_walks import SmoothedWalk, smooth_walk
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import blocks_of

PUBLISHED_EXPONENT = 10.0
LEARNED_EXPONENT = 8.0
LAYERS = 10
PUBLISHED = System("peursum", "poseppl_models.images.image_systems:peursum_system", 4)
MEASURED = System("peursum-measured", PUBLISHED.builder, 4, (("measured", True),))
"""The same with the diffusion of Darby's: half of the walk's largest changes."""
LEARNED = System("peursum-learned", "poseppl_models.peursum.factored_system:peursum_factored_system", 4)
"""The motion of section 3.3."""
TRAINING_RATE = 50.0
"""Frames a second of the walk that the motion is learned from, whatever the video's rate."""
BURN_IN_FRAMES = 5
"""Before the errors count, in which the first pose is found: the paper counts from frame 6 on."""


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each filter on each scene.
        num_frames: Number of frames of a scene.
        size: Width and height of the images, px.
        particles: The larger and the smaller number of particles; the annealed filter has the smaller in each layer.
        exponents: Each lambda.
        growth_runs: Data sets of the growth model.
        growth_particles: Numbers of particles on them.
        num_quadratic: Largest number of particles for smoothers of O(N^2) other than the paper's.
        mixture: Dimension, frames and particles of the mixtures' model.
        walk_frames: Frames of each walk in a circle or among furniture.
        walks: How many walks in circles and how many among furniture, a person each.
        walk_runs: Runs of each filter on each walk.
        rounds: Rounds of the Gibbs sampler after the learned motion and after generic ones.
        animated_frames: Frames of the animated body before one camera.
        timed_frames: Frames of each walk whose smoothers are timed.
        compared: Whether our own filters are compared with the published ones on the animated body.
    """

    runs: int = 10
    num_frames: int = 40
    size: tuple[int, int] = (640, 480)
    particles: tuple[int, int] = (10_000, 1_000)
    exponents: tuple[float, ...] = (2.5, 10.0, 30.0, 60.0, 120.0)
    growth_runs: int = 50
    growth_particles: tuple[int, ...] = (100, 200, 500, 1000, 2000, 5000)
    num_quadratic: int = 200
    mixture: tuple[int, int, int] = (10, 20, 1000)
    walk_frames: int = 60
    walks: tuple[int, int] = (5, 5)
    walk_runs: int = 2
    rounds: tuple[int, int] = (2_000, 5_000)
    animated_frames: int = 45
    timed_frames: int = 12
    compared: bool = True


FULL = Scale()
QUICK = Scale(
    runs=2,
    num_frames=5,
    size=(320, 240),
    particles=(200, 20),
    exponents=(10.0, 60.0),
    growth_runs=5,
    growth_particles=(100, 200, 500),
    mixture=(2, 5, 200),
    walk_frames=8,
    walks=(1, 1),
    rounds=(100, 100),
    animated_frames=8,
    timed_frames=8,
    compared=False,
)


def scene_of(scale: Scale, recording: Recording) -> Scene:
    """The recording without furniture."""
    return Scene(recording, False, scale.num_frames, width=scale.size[0], height=scale.size[1])


def plain(num_particles: int) -> Method:
    """The paper's particle filter."""
    return Method(f"Simple-PF, {num_particles:,}", "particle", (("num_particles", num_particles),))


def annealed(num_particles: int) -> Method:
    """The paper's annealed filter, so many particles in each layer."""
    settings = (("num_layers", LAYERS), ("num_particles", num_particles))
    return Method(f"Simple-APF, {LAYERS} x {num_particles:,}", "annealed", settings)


def plan_trackers(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Table 2: the filters on a walk, with two diffusions."""
    many, few = scale.particles
    methods = (plain(many), plain(few), annealed(few))
    rivals = [(system, method) for system in (PUBLISHED, MEASURED) for method in methods]
    return tracking_tasks([scene_of(scale, recordings[0])], rivals, scale.num_frames, scale.runs)


def plan_exponents(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Section 6.1: the plain filter over lambda, beside the annealed one, which does not know lambda."""
    many, few = scale.particles
    rivals = []
    for system in (PUBLISHED, MEASURED):
        rivals += [(_sharpened(system, exponent), plain(many)) for exponent in scale.exponents]
        rivals.append((system, annealed(few)))
    tasks = tracking_tasks([scene_of(scale, recordings[0])], rivals, scale.num_frames, scale.runs)
    return {name: tasks[name] for name in ("scenes", "tracking")}


def _sharpened(system: System, exponent: float) -> System:
    return system if exponent == PUBLISHED_EXPONENT else system.with_settings(exponent=exponent)


def learned(num_particles: int) -> Method:
    """The particle filter on the learned motion."""
    return Method(f"FSHHMM-PF, {num_particles:,}", "particle", (("num_particles", num_particles),))


def plan_walks(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Table 1 on walks in circles and among furniture; the last recording is the one that the motion is learned from.

    A single recording is also the one for learning. The furniture is not announced, as in the paper. Filters run without
    smoothers if it is announced, and filters of generic motions whenever there is furniture.
    """
    few = scale.particles[1]
    generic = [plain(few), annealed(few // LAYERS)]
    blocks = blocks_of(scale.walk_runs, 5)
    scenes = _walk_scenes(scale, recordings, scale.walks)
    scenes += [replace(scene, announced=True) for scene in scenes if not scene.announced]
    jobs = _walk_jobs(scale, scenes, recordings[-1], generic, blocks, scale.walk_frames)
    jobs = [job if _is_smoothed(job) else replace(job, smoothed=False) for job in jobs]
    pictures = [Rendering(scene) for scene in scenes if not (scene.clutter and scene.announced)]
    return {"scenes": Task(render, pictures), "walks": Task(smooth_walk, jobs)}


def _is_smoothed(job: SmoothedWalk) -> bool:
    """Whether smoothers follow: on circles, and after the learned motion among furniture that is not announced."""
    return not job.scene.clutter or (job.training is not None and not job.scene.announced)


def _walk_scenes(scale: Scale, recordings: Sequence[Recording], walks: tuple[int, int]) -> list[Scene]:
    """So many circles and walks among furniture of the first recordings, the last of several left out."""
    seen, (circles, cluttered) = recordings[:-1] or recordings, walks
    return circle_scenes(seen, circles, scale.walk_frames) + clutter_scenes(seen, cluttered, scale.walk_frames)


def _walk_jobs(
    scale: Scale,
    scenes: Sequence[Scene],
    training: Recording,
    generic: Sequence[Method],
    blocks: Sequence[tuple[int, ...]],
    num_frames: int,
) -> list[SmoothedWalk]:
    """The learned motion and generic filters on each scene, all runs of each block."""
    after_learned, after_generic = scale.rounds
    jobs = [
        SmoothedWalk(scene, LEARNED, learned(scale.particles[1]), runs, after_learned, training, num_frames=num_frames)
        for scene in scenes
        for runs in blocks
    ]
    return jobs + [
        SmoothedWalk(scene, PUBLISHED, method, runs, after_generic, num_frames=num_frames)
        for method in generic
        for scene in scenes
        for runs in blocks
    ]


def plan_monocular(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Table 3: the body animated by the walk that the motion is learned from, before one camera, of each recording.

    For comparison the likelihood is sharpened, so that one camera says as much as four, and the tables of the learned motion
    are those of the video's own rate.
    """
    jobs = [job for recording in recordings for job in _animations(scale, recording)]
    return {"monocular": Task(smooth_animation, jobs)}


def _animations(scale: Scale, walk: Recording) -> list[SmoothedAnimation]:
    """The runs before one walk's animation."""
    many, few = scale.particles
    scene = AnimatedScene(walk, scale.animated_frames)
    after_learned, after_generic = scale.rounds
    blocks = blocks_of(scale.walk_runs, 5)
    matched = replace(learned(few), name=f"FSHHMM-PF of {scene.rate:g} Hz, {few:,}")
    unlearned = PUBLISHED_EXPONENT, after_generic, None, TRAINING_RATE
    rivals = [
        (PUBLISHED, plain(few), *unlearned),
        (LEARNED, learned(few), LEARNED_EXPONENT, after_learned, walk, TRAINING_RATE),
        (PUBLISHED, plain(many), *unlearned),
        (LEARNED, matched, LEARNED_EXPONENT, after_learned, walk, scene.rate),
    ]
    if not scale.compared:
        rivals = rivals[1:3]
    jobs = []
    for system, method, exponent, rounds, training, rate in rivals:
        one_eyed, sharp = replace(system, views=1), LEARNED.views * exponent
        sharper = replace(method, name=f"{method.name}, lambda = {sharp:g}")
        pairs = [(one_eyed, method), (one_eyed.with_settings(exponent=sharp), sharper)]
        for own, filter in pairs if scale.compared else pairs[:1]:
            jobs += [SmoothedAnimation(scene, own, filter, each, rounds, training, rate) for each in blocks]
    return jobs


def plan_runtimes(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Table 4: the first circle and the first walk among furniture, with the published numbers of particles."""
    many, few = scale.particles
    generic = [plain(many), annealed(few)]
    scenes = _walk_scenes(scale, recordings, (1, 1))
    jobs = _walk_jobs(scale, scenes, recordings[-1], generic, [(0, 1)], scale.timed_frames)
    return {"scenes": Task(render, [Rendering(scene) for scene in scenes]), "runtimes": Task(smooth_walk, jobs)}


def plan_dimensionality(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Section 7.1: smoothers on the growth model of one and of three dimensions."""
    jobs = []
    for dimension in (1, 3):
        jobs.append(GrowthRuns(dimension, EXACT, 0, scale.growth_runs))
        for number in scale.growth_particles:
            jobs += [
                GrowthRuns(dimension, name, number, scale.growth_runs)
                for name, smoother in SMOOTHERS.items()
                if name == FBS or not smoother.is_quadratic or number <= scale.num_quadratic
            ]
    return {"growth": Task(smooth_growth, jobs)}


def plan_mixtures(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Section 4.3: smoothers on the mixture."""
    return {"mixtures": Task(smooth_mixture, [MixtureRun(name, *scale.mixture) for name in (FILTER, *MIXTURE_SMOOTHERS)])}
