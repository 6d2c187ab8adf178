"""The jobs of the contest: which method has the smallest error of one frame's mean per second and per evaluation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import numpy as np
from jax import Array

from poseppl.compilation import jit
from poseppl.runs.algorithms import FILTERS
from poseppl_papers.choo_fleet.sequence import Settings
from poseppl_papers.choo_fleet.systems import frame_of
from poseppl_papers.choo_fleet.tracker_job import TrackerJob
from poseppl_papers.clock import timed
from poseppl_papers.recordings import Recording

_SEED = 28


_PUBLISHED = {
    "num_chains": 10,
    "num_leapfrog": 40,
    "num_warmup": 6,
    "step_size": 0.25,
    "target_acceptance": None,
    "jitter": 0.0,
}
_DENSE = {"dense_mass": True, "num_leapfrog": 8, "num_warmup": 6, "step_size": 0.4, "target_acceptance": 0.85, "jitter": 0.5}
CONTESTANTS: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "particle filter": ("particle", {"num_particles": 108_000}),
    "HMC, as published": ("hmc", {**_PUBLISHED, "num_updates": 32}),
    "HMC, dense mass": ("hmc", {**_DENSE, "num_chains": 10, "num_updates": 32}),
    "HMC, dense mass, 60 chains": ("hmc", {**_DENSE, "num_chains": 60, "num_updates": 12}),
    "assumed density": ("assumed-density", {}),
    "assumed density, 1 Gaussian": ("assumed-density", {"num_components": 1}),
    "assumed density, 80 climbers": ("assumed-density", {"num_starts": 80}),
    "assumed density, short": ("assumed-density", {"num_updates": 16, "num_leapfrog": 6}),
    "window of 3": ("window", {"window": 3}),
    "tempered": ("tempered", {"num_particles": 500}),
    "guided": ("guided", {"num_particles": 2000}),
    "auxiliary": ("guided", {"num_particles": 2000, "auxiliary": True}),
    "extended Kalman": ("kalman", {"num_particles": 1000}),
    "unscented Kalman": ("kalman", {"num_particles": 1000, "linearisation": "unscented"}),
}
"""Methods by name: a filter of the library and its settings."""


def settings_of(method: str) -> tuple[str, Settings]:
    """The filter and its settings, as a job holds them."""
    filter, settings = CONTESTANTS[method]
    return filter, tuple(sorted(settings.items()))


@dataclass(frozen=True)
class ContestRuns(TrackerJob):
    """Runs of one filter at one frame; noise, prior and reference are those of :mod:`.single_frame`.

    Attributes:
        frame: Index of the frame.
        method: Name of the filter in tables.
        filter: Its name in the library.
        settings: Its settings.
        runs: Numbers of the runs.
    """

    frame: int
    method: str
    filter: str
    settings: Settings
    runs: tuple[int, ...]

    @property
    def name(self) -> str:
        """Tracker, recording, frame and method."""
        return f"contest-{self.system}-{self.recording.name}-{self.frame}-{self.method}"

    @property
    def cost(self) -> float:
        """Relative to a second."""
        return 5.0 + 0.2 * len(self.runs)


def contest_frame(job: ContestRuns) -> dict[str, Any]:
    """Run the filter.

    Returns:
        ``mean`` (run, d), ``seconds`` (run,) without compilation, ``num_likelihood`` and ``num_gradient`` (run,).
    """
    frame = frame_of(job.recording, job.system, job.frame)
    function = _compiled(job.recording, job.system, job.filter, job.settings)
    rows = []
    for run in job.runs:
        key = jax.random.fold_in(jax.random.key(_SEED), run * 1000 + job.frame)
        (mean, info), seconds = timed(function, key, frame.observe(run), frame.inputs)
        rows.append((mean, seconds, float(info.num_likelihood), float(info.num_gradient)))
    names = ("mean", "seconds", "num_likelihood", "num_gradient")
    return {name: np.array([row[number] for row in rows]) for number, name in enumerate(names)}


@lru_cache(maxsize=16)
def _compiled(recording: Recording, system: str, filter: str, settings: Settings) -> Any:
    """The filter at one frame, run once so that it is compiled."""
    frame = frame_of(recording, system, 1)
    built, _ = FILTERS[filter].build(frame.problem.model, dict(settings))

    def run(rng_key: Array, observation: Any, inputs: Any) -> Any:
        state, info = built.init(rng_key, observation, inputs)
        particles = state.particles.reshape(-1, state.particles.shape[-1])
        return jax.nn.softmax(state.log_weights.reshape(-1)) @ particles, info

    function = jit(run)
    timed(function, jax.random.key(0), frame.observe(0), frame.inputs)
    return function
