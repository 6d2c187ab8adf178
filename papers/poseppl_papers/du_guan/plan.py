"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from poseppl_papers.du_guan.mueller import SAMPLERS, MuellerRuns, sample_mueller
from poseppl_papers.experiment import Task
from poseppl_papers.images.scenes import Scene
from poseppl_papers.images.systems import Method, System
from poseppl_papers.images.tracking import tracking_tasks
from poseppl_papers.recordings import Recording

SYSTEM = System("du-guan", "poseppl_models.images.image_systems:du_guan_system", 1)
EVALUATIONS = 5_000, 3_500
"""Evaluations a frame of CONDENSATION and the annealed filter, and of DE-MC."""
PREDICTIONS = ("velocity", "transition")
READINGS = {"equation": "survival", "text": "degeneracy"}
"""Diagnostic with which the noise grows: the survival diagnostic, as in Eq. 7, or its inverse, as in the text below Eq. 7."""
SIGMAS = {"particles": "particles", "walk": "transition"}
"""Whose standard deviations sigma is."""
SHIPPED = 0.1, "equation", "particles"
"""c, the reading of Eq. 7 and sigma of `demc_filter`."""
CHOSEN = 0.3, "equation", "walk"
"""Those of the least absolute error on the part "noise", whose walks are not among the sequences; no larger c was tried."""
TUNED = ", chosen noise"
"""In the names of filters with :data:`CHOSEN`."""
SEQUENCES = ((7, 500), (9, 600))
"""Layers and particles of a layer, of the first sequence and of the others."""
CUES = {"overlap_scale": 1.0, "colour_scale": 0.3, "boundary_scale": 0.3}
"""Scales of the three cues as the other parts have them."""


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Runs of each filter.
        num_frames: How many are tracked.
        scene_frames: Frames of the scene, whose largest changes between frames are the diffusion.
        size: Width and height of the images, px.
        share: Share of the published numbers of particles.
        layers: Numbers of DE-MC's layers.
        members: Samples on Mueller's surface.
        iterations: Iterations of each.
        surface_runs: Runs of each sampler.
        temperatures: Temperatures of the surface.
        sequence_frames: Frames of each sequence.
        factors: Factors of the scale of one cue after the other.
        noises: c of the part "noise".
        noise_frames: Frames of its walks.
        noise_runs: Runs of each filter on each of its walks.
    """

    runs: int = 10
    num_frames: int = 30
    scene_frames: int = 40
    size: tuple[int, int] = (640, 480)
    share: float = 1.0
    layers: tuple[int, ...] = (2, 5, 7)
    members: int = 200
    iterations: int = 30
    surface_runs: int = 20
    temperatures: tuple[float, ...] = (5.0, 15.0, 50.0)
    sequence_frames: int = 40
    factors: tuple[float, ...] = (1 / 3, 3.0)
    noises: tuple[float, ...] = (0.03, 0.1, 0.3)
    noise_frames: int = 10
    noise_runs: int = 5


FULL = Scale()
QUICK = Scale(
    runs=2,
    num_frames=5,
    scene_frames=5,
    size=(320, 240),
    share=0.02,
    layers=(2, 7),
    members=40,
    surface_runs=4,
    sequence_frames=5,
    factors=(3.0,),
    noises=(0.1,),
    noise_frames=5,
    noise_runs=2,
)


def methods(scale: Scale) -> list[Method]:
    """The filters of Figs. 4 and 5; the first population of DE-MC is evaluated, too, so that T layers have T + 1 of them."""
    whole, shorter = (round(scale.share * number) for number in EVALUATIONS)
    layer = whole // 10
    found = [
        Method(f"CONDENSATION, {whole:,}", "particle", (("num_particles", whole),)),
        Method(f"APF, 10 x {layer:,}", "annealed", (("num_layers", 10), ("num_particles", layer))),
    ]
    for prediction in PREDICTIONS:
        for layers in scale.layers:
            count = shorter // (layers + 1)
            found.append(layered(layers, count, prediction))
    return found + [chosen(layered(layers, shorter // (layers + 1), PREDICTIONS[0])) for layers in scale.layers]


def _scene(scale: Scale, recording: Recording, num_frames: int) -> Scene:
    return Scene(recording, False, num_frames, width=scale.size[0], height=scale.size[1])


def plan_trackers(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Figs. 4 and 5: average sample weights."""
    scene = _scene(scale, recordings[0], scale.scene_frames)
    rivals = [(SYSTEM, method) for method in methods(scale)]
    return tracking_tasks([scene], rivals, scale.num_frames, scale.runs, weighs=True)


def layered(layers: int, members: int, prediction: str) -> Method:
    """DE-MC of so many layers, of so many particles each."""
    settings = (("num_layers", layers), ("num_particles", members), ("prediction", prediction))
    return Method(f"DE-MC ({prediction}), {layers} layers of {members:,}", "demc", settings)


def noisy(method: Method, noise: float, reading: str, sigma: str, name: str) -> Method:
    """DE-MC with another c, reading of Eq. 7 and sigma."""
    settings = (("noise", noise), ("noise_follows", READINGS[reading]), ("noise_scale", SIGMAS[sigma]))
    return Method(name, method.filter, (*method.settings, *settings))


def chosen(method: Method) -> Method:
    """DE-MC with the noise that was chosen on other walks."""
    return noisy(method, *CHOSEN, method.name + TUNED)


def plan_noise(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Sequence 1's filter on other walks, over c, both readings of Eq. 7 and both sigmas; all recordings."""
    scenes = [_scene(scale, recording, scale.noise_frames) for recording in recordings]
    layers, members = SEQUENCES[0]
    method = layered(layers, round(scale.share * members), PREDICTIONS[0])
    rivals = [
        (SYSTEM, noisy(method, noise, reading, sigma, f"{noise:g}, {reading}, {sigma}"))
        for noise in scale.noises
        for reading in READINGS
        for sigma in SIGMAS
    ]
    return tracking_tasks(scenes, rivals, scale.noise_frames, scale.noise_runs)


def plan_sequences(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Fig. 3: the first recording is sequence 1, tracked by 7 layers of 500, the others are tracked by 9 layers of 600."""
    tasks: dict[str, Task] = {}
    for number, recording in enumerate(recordings):
        scene = _scene(scale, recording, scale.sequence_frames)
        layers, members = SEQUENCES[min(number, 1)]
        method = layered(layers, round(scale.share * members), PREDICTIONS[0])
        rivals = [(SYSTEM, method), (SYSTEM, chosen(method))]
        own = tracking_tasks([scene], rivals, scale.sequence_frames, scale.runs, weighs=True)
        tasks = {name: Task(task.function, [*(tasks[name].jobs if tasks else ()), *task.jobs]) for name, task in own.items()}
    return tasks


def plan_scales(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Sequence 1 with the scale of one cue after the other changed."""
    scene = _scene(scale, recordings[0], scale.scene_frames)
    layers, members = SEQUENCES[0]
    method = layered(layers, round(scale.share * members), PREDICTIONS[0])
    changed = [(cue, factor * value) for cue, value in CUES.items() for factor in scale.factors]
    systems = [SYSTEM, *(replace(SYSTEM, name=f"{cue} {value:.2g}", settings=((cue, value),)) for cue, value in changed)]
    return tracking_tasks([scene], [(system, method) for system in systems], scale.num_frames, scale.runs, weighs=True)


def plan_mueller(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Fig. 2b: who finds the basins of Mueller's surface."""
    jobs = [
        MuellerRuns(sampler, temperature, scale.members, scale.iterations, scale.surface_runs)
        for temperature in scale.temperatures
        for sampler in SAMPLERS
    ]
    return {"surface": Task(sample_mueller, jobs)}
