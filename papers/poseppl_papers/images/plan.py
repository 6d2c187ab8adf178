"""Tasks of a part that runs filters on scenes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from poseppl_papers.experiment import Task
from poseppl_papers.images.scenes import Rendering, Scene, render
from poseppl_papers.images.systems import Method, System
from poseppl_papers.images.tracking import Blind, Tracking, blind, track
from poseppl_papers.runs import blocks_of


def tracking_tasks(
    scenes: Sequence[Scene],
    rivals: Iterable[tuple[System, Method]],
    num_frames: int,
    num_runs: int,
    *,
    weighs: bool = False,
) -> dict[str, Task]:
    """Render the scenes, then run each system's filters on them.

    Args:
        scenes: The scenes.
        rivals: Systems, each with a filter.
        num_frames: How many frames of a scene.
        num_runs: How many runs of each filter.
        weighs: Whether the particles' mean likelihood is taken.

    Returns:
        The tasks "scenes", "blind" and "tracking".
    """
    pairs = list(rivals)
    systems = dict.fromkeys(system for system, _ in pairs)
    sightless = [Blind(scene, system, num_frames) for system in systems for scene in scenes]
    tracked = [
        Tracking(scene, system, num_frames, method, runs, weighs)
        for system, method in pairs
        for scene in scenes
        for runs in blocks_of(num_runs, 5)
    ]
    return {
        "scenes": Task(render, [Rendering(scene) for scene in scenes]),
        "blind": Task(blind, sightless),
        "tracking": Task(track, tracked),
    }
