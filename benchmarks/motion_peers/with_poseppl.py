"""poseppl: what `poseppl track keypoints` does by default with several cameras, the smoother without a filter.

It reads the detector's files itself. Cameras are taken as they are, as for the others; segment lengths, noise and the right
person it finds by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from given import Answer, Given

from benchmarks.timing import DATA
from poseppl.cli.console import start_jax
from poseppl.motion.tracking import smooth_recording
from studies.keypoints import scene_of

NAME, PACKAGE = "poseppl", "poseppl"


def methods(given: Given) -> dict[str, Callable[[], Answer]]:
    """The smoother's answer, which users get."""
    start_jax()
    folder = DATA / "pose2sim_balancing"
    cameras, frames = tuple(int(number) for number in given.cameras), f"0:{len(given.points)}"

    def smoothed() -> Answer:
        tree = smooth_recording(scene_of(folder, cameras, frames).scene).result
        draws = np.asarray(tree["posterior/markers"].values, np.float64)
        names = [str(name) for name in tree["summary"]["marker"].values]
        draws = draws.reshape(-1, *draws.shape[2:])[:, :, [names.index(name) for name in given.names]]
        return Answer(draws.mean(0), draws)

    return {"smoother": smoothed}
