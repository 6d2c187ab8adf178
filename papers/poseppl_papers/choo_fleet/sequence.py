"""Section 7.4 and the contest: any filter of the library on a sequence, run after run; jobs and tables (Figs. 4 and 5)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from poseppl.arrays import Floats
from poseppl.compilation import jit
from poseppl.diagnostics.calibration import between
from poseppl.filters.base import Filter
from poseppl.filters.chains import ChainState
from poseppl.filters.scan import scan_filter
from poseppl.motion.measures import joint_error
from poseppl.motion.tracking.problem import Problem
from poseppl.program.population import log_transitions_into
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.results import QUANTILES
from poseppl_papers.choo_fleet.systems import Stage, TrackerJob, noisy_points, pose_sequence, stage_of
from poseppl_papers.experiment import Results
from poseppl_papers.measured import mean_and_error
from poseppl_papers.recordings import Recording
from poseppl_papers.runs import joined, stacked, timed
from poseppl_papers.tables import Table, grouped

Settings = tuple[tuple[str, Any], ...]
LEVELS = (0.5, 0.9)
_SEED = 74


@dataclass(frozen=True)
class SequenceRuns(TrackerJob):
    """Runs of one filter on one sequence.

    Attributes:
        method: Name of the filter in tables.
        filter: Its name in the library.
        settings: Its settings.
        num_frames: How many frames, from the second on.
        runs: Numbers of the runs; each has noise of its own, which all filters share.
    """

    version: ClassVar[int] = 2
    method: str
    filter: str
    settings: Settings
    num_frames: int
    runs: tuple[int, ...]

    @property
    def name(self) -> str:
        """Tracker, recording, method and the first run."""
        return f"sequence-{self.system}-{self.recording.name}-{self.method}-{self.runs[0]}".replace(",", "")

    @property
    def cost(self) -> float:
        """Relative to a second."""
        settings = FILTERS[self.filter].complete(dict(self.settings))
        size = settings.get("num_particles", 0) * 3e-6
        if "num_chains" in settings:
            size = settings["num_chains"] * settings["num_updates"] * settings["num_leapfrog"] * 4e-6
        return 5.0 + len(self.runs) * self.num_frames * max(float(size), 0.01)


def run_sequence(job: SequenceRuns) -> dict[str, Any]:
    """Run the filter.

    Returns:
        For each run and frame (run, frame): ``log_likelihood`` of the mean state, ``log_prior`` of the true state given the
        past (NaN at the first frame), ``error`` and ``error_relative`` of the markers' means (mm), ``num_likelihood`` and
        ``num_gradient``. The shares of coordinates inside of their central intervals are ``inside_state`` and
        ``inside_markers`` (run, level, frame). Means are ``mean`` (run, frame, d) and ``markers`` (run, frame, marker, 3).
        ``seconds`` (run,) is the time of the whole sequence without compilation.
    """
    function = _compiled(job.recording, job.system, job.filter, job.settings, job.num_frames)

    def find(rng_key: Array, problem: Problem, truth: Floats) -> tuple[dict[str, Any], float]:
        return timed(function, rng_key, _arguments(problem, truth))

    return score_runs(job, find)


def score_runs(job: SequenceRuns, find: Callable[[Array, Problem, Floats], tuple[dict[str, Any], float]]) -> dict[str, Any]:
    """Compare what is found in each run of a job, and the seconds that it took, with the truth."""
    frames = slice(1, 1 + job.num_frames)
    rows: list[dict[str, Any]] = []
    for run in job.runs:
        stage = stage_of(job.recording, job.system, run)
        problem = pose_sequence(stage, frames, noisy_points(stage, frames, run))
        found, seconds = find(jax.random.fold_in(jax.random.key(_SEED), run), problem, true_states(stage, frames))
        rows.append({"seconds": seconds} | _score(found, stage, frames))
    return stacked(rows)


def true_states(stage: Stage, frames: slice) -> Floats:
    """The free coordinates (T, d)."""
    return stage.states[frames][:, list(stage.body.free_coordinates)]


def _score(found: Mapping[str, Any], stage: Stage, frames: slice) -> dict[str, Any]:
    markers = stage.markers[frames]
    root = stage.body.tree.marker_names.index(stage.body.root)
    distance = joint_error(found["markers_mean"], markers, root)
    return {
        **{name: found[name] for name in ("log_likelihood", "log_prior", "num_likelihood", "num_gradient")},
        "mean": found["state_mean"],
        "markers": found["markers_mean"],
        "error": np.mean(distance.absolute, -1),
        "error_relative": np.mean(distance.relative, -1),
        "inside_state": _inside(found["state_quantile"], true_states(stage, frames)),
        "inside_markers": _inside(found["markers_quantile"], markers),
    }


def _inside(quantiles: Any, truth: Any) -> Floats:
    """Share of coordinates in the central intervals, (level, frame)."""
    shares = []
    for level in LEVELS:
        low, high = (int(np.argmin(np.abs(np.array(QUANTILES) - (1 + sign * level) / 2))) for sign in (-1, 1))
        hits = between(quantiles[:, low], quantiles[:, high], truth)
        shares.append(hits.reshape(len(hits), -1).mean(1))
    return np.stack(shares)


class _Known(NamedTuple):
    """Known values of a frame: the model's inputs, the data and the true state (d,), with which a filter is compared."""

    inputs: Any
    observation: Any
    truth: Any


def _arguments(problem: Problem, truth: Any) -> _Known:
    arguments: _Known = jax.device_put(_Known(problem.inputs, problem.observations, jnp.asarray(truth)))
    return arguments


@lru_cache(maxsize=8)
def _compiled(recording: Recording, system: str, filter: str, settings: Settings, num_frames: int) -> Callable[..., Any]:
    """The filter over a whole sequence, run once so that it is compiled."""
    stage = stage_of(recording, system)
    frames = slice(1, 1 + num_frames)
    problem = pose_sequence(stage, frames, stage.points[frames])
    model = problem.model
    built, _ = FILTERS[filter].build(model, dict(settings))
    judged = Filter(
        lambda rng_key, data, known: built.init(rng_key, data, known.inputs),
        lambda rng_key, state, data, known: built.step(rng_key, state, data, known.inputs),
    )
    collect = problem.collector(2)

    def measure(rng_key: Array, state: Any, info: Any, known: _Known) -> dict[str, Array]:
        summary = collect(rng_key, state, info, known.inputs).summary
        kept = {name: summary[name] for name in ("state_mean", "state_quantile", "markers_mean", "markers_quantile")}
        kept["log_likelihood"] = model.log_observation(summary["state_mean"], known.observation, known.inputs)
        return kept | {"num_likelihood": info.num_likelihood, "num_gradient": info.num_gradient}

    def log_prior(rng_key: Array, state: Any, first: Array, observation: Any, known: _Known) -> Array:
        """Log-density of the true state under the mixture of transitions from the last frame's particles."""
        particles, weights = state.particles, state.log_weights
        if isinstance(state, ChainState):  # the last draw of each chain, as in Eq. 9
            particles, weights = particles[:, -1], weights[:, -1]
        terms = log_transitions_into(model, known.truth, particles.reshape(-1, model.dimension), known.inputs)
        weights = weights.reshape(-1)
        return jnp.where(first, jnp.nan, jax.nn.logsumexp(terms + weights) - jax.nn.logsumexp(weights))

    def run(rng_key: Array, known: _Known) -> dict[str, Array]:
        scan = scan_filter(judged, rng_key, known.observation, known, collect=measure, predict=log_prior)
        return {**scan.outputs, "log_prior": scan.prediction}

    function = jit(run)
    timed(function, jax.random.key(0), _arguments(problem, true_states(stage, frames)))
    return function


def sequence_tables(jobs: Sequence[SequenceRuns], results: Results) -> list[Table]:
    """Tables of Figs. 4 and 5, frame by frame, and their summary."""
    rows = []
    for (tracker, _, method), whole in _grouped(jobs, results).items():
        for frame in range(whole["error"].shape[1]):
            values = [mean_and_error(whole[name][:, frame]) for name in ("log_likelihood", "log_prior", "error")]
            rows.append((tracker, method, frame, *(number for pair in values for number in pair)))
    names = ("log_likelihood", "log_prior", "error")
    columns = ("tracker", "method", "frame", *(column for name in names for column in (name, f"{name}_standard_error")))
    about = "Log-likelihood of the mean state, log prior of the true state, and markers' error (mm): means over runs."
    return [Table("sequence", columns, rows, about), performance("sequence_summary", jobs, results)]


def performance(name: str, jobs: Sequence[SequenceRuns], results: Results) -> Table:
    """Error, coverage, spread and cost of each filter on each recording, over all frames and runs."""
    rows = []
    for (tracker, recording, method), whole in _grouped(jobs, results).items():
        error, relative = (mean_and_error(whole[key].mean(1)) for key in ("error", "error_relative"))
        cover = [mean_and_error(whole["inside_markers"][:, index].mean(1)) for index in range(len(LEVELS))]
        state = [mean_and_error(whole["inside_state"][:, index].mean(1))[0] for index in range(len(LEVELS))]
        spread = float(np.sqrt(np.mean(np.var(whole["markers"], axis=0, ddof=1)) * 3)) if len(whole["markers"]) > 1 else np.nan
        frames = whole["error"].shape[1]
        evaluations = float((whole["num_likelihood"] + whole["num_gradient"]).mean())
        rate = frames / float(np.median(whole["seconds"]))
        covered = [number for pair in cover for number in pair]
        rows.append((tracker, recording, method, *error, relative[0], *covered, *state, spread, rate, evaluations))
    columns = (
        "tracker",
        "recording",
        "method",
        "error",
        "error_standard_error",
        "error_relative",
        "markers_in_50",
        "markers_in_50_standard_error",
        "markers_in_90",
        "markers_in_90_standard_error",
        "state_in_50",
        "state_in_90",
        "spread",
        "frames_per_second",
        "evaluations_per_frame",
    )
    about = (
        "Mean distance of the markers from the truth (mm) and relative to the pelvis, share of true coordinates inside central "
        "intervals, root mean square distance (mm) of a run's means from those of all runs, and cost."
    )
    return Table(name, columns, rows, about)


def _grouped(jobs: Sequence[SequenceRuns], results: Results) -> dict[tuple[str, str, str], Mapping[str, Any]]:
    groups = grouped(jobs, lambda job: (job.system, job.recording.name, job.method))
    return {key: joined(own, results) for key, own in groups.items()}
