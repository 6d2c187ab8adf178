"""Which jobs each part has, and how large they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from poseppl.experiments.du_guan.mueller import SAMPLERS, MuellerRuns, sample_mueller
from poseppl.experiments.experiment import Task
from poseppl.experiments.images.plan import tracking_tasks
from poseppl.experiments.images.scenes import Scene
from poseppl.experiments.images.systems import Method, System
from poseppl.experiments.recordings import Recording

SYSTEM = System("du-guan", "poseppl_models.image_systems:du_guan_system", 1)
EVALUATIONS = 5_000, 3_500
"""Of CONDENSATION and the annealed filter, and of DE-MC, a frame."""
PREDICTIONS = ("velocity", "transition")


class Scale(NamedTuple):
    """How much is computed.

    Attributes:
        runs: Of each filter.
        num_frames: How many are tracked.
        scene_frames: Of the scene, whose largest changes between frames are the diffusion.
        size: Width and height of the images, px.
        share: Of the published numbers of particles.
        layers: Numbers of DE-MC's layers.
        members: Samples on Mueller's surface.
        iterations: Of each.
        surface_runs: Runs of each sampler.
        temperatures: Of the surface.
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


FULL = Scale()
QUICK = Scale(runs=2, num_frames=5, scene_frames=5, size=(320, 240), share=0.02, layers=(2, 7), members=40, surface_runs=4)


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
            settings = (("num_layers", layers), ("num_particles", count), ("prediction", prediction))
            found.append(Method(f"DE-MC ({prediction}), {layers} layers of {count:,}", "demc", settings))
    return found


def plan_trackers(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Figs. 4 and 5: average sample weights."""
    scene = Scene(recordings[0], False, scale.scene_frames, width=scale.size[0], height=scale.size[1])
    rivals = [(SYSTEM, method) for method in methods(scale)]
    return tracking_tasks([scene], rivals, scale.num_frames, scale.runs, weighs=True)


def plan_mueller(scale: Scale, recordings: Sequence[Recording]) -> dict[str, Task]:
    """Fig. 2b: who finds the basins of Mueller's surface."""
    jobs = [
        MuellerRuns(sampler, temperature, scale.members, scale.iterations, scale.surface_runs)
        for temperature in scale.temperatures
        for sampler in SAMPLERS
    ]
    return {"surface": Task(sample_mueller, jobs)}
