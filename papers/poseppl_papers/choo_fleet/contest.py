"""The contest: which method has the smallest error of one frame's mean per second; and a smoother that sees the future."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.filters import assumed_density_filter
from poseppl.filters.chains import ChainState
from poseppl.motion.tracking.problem import Problem
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.run import run_filter
from poseppl.smoothers import History, collect_history, trajectory_smoother
from poseppl_papers.choo_fleet.frame_tables import geometric_variance, log_standard_error
from poseppl_papers.choo_fleet.sequence import SequenceRuns, Settings, score_runs
from poseppl_papers.choo_fleet.single_frame import FrameRuns
from poseppl_papers.choo_fleet.systems import TrackerJob, frame_of, pose_sequence, stage_of
from poseppl_papers.experiment import Results
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import timed
from poseppl_papers.tables import Table, grouped

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


def contest_table(jobs: Sequence[ContestRuns], frames: Sequence[FrameRuns], results: Results) -> Table:
    """One row a method, averaged geometrically over recordings and frames."""
    references = _references(frames, results)
    rows = [_row(method, own, references, results) for method, own in grouped(jobs, lambda job: job.method).items()]
    columns = (
        "method",
        "variance",
        "log_standard_error",
        "bias",
        "seconds",
        "evaluations",
        "effective_draws_per_second",
        "effective_draws_per_evaluation",
    )
    about = (
        "Geometric mean over coordinates, frames and recordings of the mean's squared error, in units of the posterior's "
        "variance; bias is the root mean square over coordinates of the mean error over runs, in standard deviations; one over "
        "the variance is the number of independent draws that an estimate is worth. Seconds are the median over frames and "
        "runs. At one frame, filters that differ only in what they carry to the next one (1 Gaussian or 3, guided or "
        "auxiliary) are the same filter."
    )
    return Table("contest", columns, rows, about)


def _references(frames: Sequence[FrameRuns], results: Results) -> dict[tuple[str, int, int], Mapping[str, Any]]:
    """Reference mean, standard error and posterior variance by recording, frame and run."""
    found: dict[tuple[str, int, int], Mapping[str, Any]] = {}
    for job in frames:
        block = results[job.key]
        for index, run in enumerate(job.runs):
            found[job.recording.name, job.frame, run] = {
                "mean": np.asarray(block["reference_mean"][index], float),
                "error": np.asarray(block["reference_standard_error"][index], float),
                "variance": np.diagonal(np.asarray(block["reference_covariance"][index], float)),
            }
    return found


def _row(method: str, jobs: Sequence[ContestRuns], references: Mapping[Any, Any], results: Results) -> tuple[Any, ...]:
    logs, spreads, biases, seconds, evaluations = [], [], [], [], []
    for job in jobs:
        block = results[job.key]
        known = [references[job.recording.name, job.frame, run] for run in job.runs]
        scaled = np.stack([(block["mean"][i] - each["mean"]) / each["variance"] ** 0.5 for i, each in enumerate(known)])
        own = np.stack([each["error"] ** 2 / each["variance"] for each in known])
        squared = (scaled**2 - own)[:, None]
        logs.append(np.log(geometric_variance(squared)[0]))
        spreads.append(log_standard_error(squared)[0])
        noise = np.mean(scaled.var(0, ddof=1)) / len(scaled)
        biases.append(max(0.0, float(np.mean(scaled.mean(0) ** 2) - noise)))
        seconds.append(np.median(block["seconds"]))
        evaluations.append(np.mean(block["num_likelihood"] + block["num_gradient"]))
    variance = float(np.exp(np.mean(logs)))
    spread = float(np.sqrt(np.square(spreads).sum()) / len(spreads))
    second, evaluation = float(np.median(seconds)), float(np.mean(evaluations))
    per_second, per_evaluation = 1 / (variance * second), 1 / (variance * evaluation)
    return method, variance, spread, float(np.sqrt(np.mean(biases))), second, evaluation, per_second, per_evaluation


_KEPT = ("state_mean", "state_quantile", "markers_mean", "markers_quantile")


@dataclass(frozen=True)
class TrajectoryRuns(SequenceRuns):
    """Runs of the smoother on one sequence, from the history of the default filter; ``settings`` are the smoother's."""

    @property
    def cost(self) -> float:
        """Relative to a second."""
        return 100.0 + len(self.runs) * self.num_frames


def run_trajectory(job: TrajectoryRuns) -> dict[str, Any]:
    """Filter and smooth; what comes back is as that of :func:`~.sequence.run_sequence`, without a log prior."""
    run = _compiled_smoother(job.recording, job.system, job.settings, job.num_frames)

    def find(rng_key: Array, problem: Problem, _: Floats) -> tuple[dict[str, Any], float]:
        return timed(run, rng_key, problem)

    return score_runs(job, find)


@lru_cache(maxsize=4)
def _compiled_smoother(
    recording: Recording, system: str, settings: Settings, num_frames: int
) -> Callable[[Array, Problem], dict[str, Any]]:
    """Filter and smoother, run once so that they are compiled."""
    stage = stage_of(recording, system)
    frames = slice(1, 1 + num_frames)
    first = pose_sequence(stage, frames, stage.points[frames])
    model = first.model
    tracker = assumed_density_filter(model)
    smoother = trajectory_smoother(model, **dict(settings))
    collect = first.collector(2)

    def smooth(rng_key: Array, history: History, observations: Any, inputs: Any) -> dict[str, Array]:
        smoothed = smoother.smooth(rng_key, history, observations, inputs)
        keys = jax.random.split(rng_key, num_frames)

        def measure(row: Any) -> dict[str, Array]:
            key, draws, weights, observation, inputs = row
            summary = collect(key, ChainState(draws, weights, jnp.zeros(()), jnp.ones((), bool)), None, inputs).summary
            log_likelihood = model.log_observation(summary["state_mean"], observation, inputs)
            return {"log_likelihood": log_likelihood, **{name: summary[name] for name in _KEPT}}

        found: dict[str, Array] = jax.lax.map(measure, (keys, smoothed.particles, smoothed.log_weights, observations, inputs))
        return found | {"num_gradient": jnp.full(num_frames, smoothed.info.num_gradient / num_frames)}

    compiled = jit(smooth)

    def run(rng_key: Array, problem: Problem) -> dict[str, Any]:
        key_filter, key_smooth = jax.random.split(rng_key)
        filtered = run_filter(tracker, key_filter, problem.observations, problem.inputs, collect=collect_history)
        inputs = frame_sequence(problem.observations, problem.inputs, num_frames).stacked_inputs()
        history = History(*jax.tree.map(jnp.asarray, filtered.outputs))
        found = dict(compiled(key_smooth, history, problem.observations, inputs))
        return found | {
            "log_prior": np.full(num_frames, np.nan),
            "num_likelihood": filtered.info.num_likelihood,
            "num_gradient": found["num_gradient"] + filtered.info.num_gradient,
        }

    timed(run, jax.random.key(0), first)
    return run
