"""Does smoothing pay with a learned motion? Peursum, Venkatesh and West (2010, section 8) leave that to be tried.

The motion is Darby's four components with their Markov model, the particles those of the guided filter, and the smoothers
forward-backward and backward simulation. The error is that of the mean posture over all fifteen virtual markers, mm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from poseppl.arrays import Floats
from poseppl.runs.algorithms import SMOOTHERS
from poseppl.runs.run import Constant
from poseppl.runs.smoothing import run_smoother
from poseppl.smoothers import History
from poseppl_papers.darby.people import Taught, person_of, taught_runs
from poseppl_papers.experiment import Jobs, Results, Tables
from poseppl_papers.images.systems import Problem
from poseppl_papers.images.tracking import first_state
from poseppl_papers.measured import MATTERS, Interval, mean_interval
from poseppl_papers.peursum.tracks import posture_squares
from poseppl_papers.runs import finished, stacked
from poseppl_papers.tables import Table, grouped, markdown

ALGORITHMS = ("filter", "forward-backward", "backward-simulation")
_COLUMNS = ("system", "person", "scene", "method", "run", *(name.replace("-", "_") for name in ALGORITHMS), "ess_share")
_ABOUT = (
    "Root mean square distance of the mean posture's virtual markers from the truth, mm, over the frames of a run: of the "
    "filter, and of smoothers on its particles; and the filter's mean ESS as a share of its particles."
)


def smooth_taught(job: Taught) -> dict[str, Any]:
    """Run the guided filter, and the smoothers on its particles.

    Returns:
        ``errors`` (run, algorithm), mm, by :data:`ALGORITHMS`, and ``ess_share`` (run,).
    """
    rows = []
    for run, problem, filter, step in taught_runs(job):
        state, kept = first_state(problem, filter, run), []
        for number, inputs in enumerate(problem.frames):
            key = jax.random.fold_in(jax.random.key(run + 1), number)
            (state, info), _ = finished(step, key, state, problem.model.observe({}), inputs)
            kept.append((state.particles, jax.nn.log_softmax(state.log_weights), float(info.ess)))
        particles, log_weights = jnp.stack([each[0] for each in kept]), jnp.stack([each[1] for each in kept])
        errors = [_error(problem, particles, log_weights)]
        errors += [_error(problem, *smoothed(problem, name, particles, log_weights, run)) for name in ALGORITHMS[1:]]
        share = np.mean([each[2] for each in kept]) / particles.shape[1]
        rows.append({"errors": np.array(errors), "ess_share": share})
    return stacked(rows)


def smoothed(problem: Problem, name: str, particles: Any, log_weights: Any, seed: int) -> tuple[Any, Any]:
    """Particles (T, N, d) and log-weights (T, N) of a smoother, from those of the filter."""
    frames, count = log_weights.shape
    history = History(particles, log_weights, jnp.zeros((frames, 0), int), jnp.zeros(frames, bool))
    smoother, _ = SMOOTHERS[name].build(problem.model, {"num_trajectories": count} if name == ALGORITHMS[2] else {})
    nothing = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (frames, *leaf.shape)), problem.model.observe({}))
    known = jax.tree.map(Constant, problem.frames[0])  # of which transitions read what is the same in all frames
    states, weights = run_smoother(smoother, jax.random.key(seed), history, nothing, known, collect=_whole).outputs
    return states.reshape(frames, -1, states.shape[-1]), weights.reshape(frames, -1)


def _whole(rng_key: Any, state: Any, info: Any, inputs: Any) -> tuple[Any, Any]:
    return state.particles, state.log_weights


def _error(problem: Problem, particles: Any, log_weights: Any) -> float:
    """Root mean square error of the mean postures of particles (T, N, d), mm."""
    weights: Floats = np.exp(np.asarray(log_weights, np.float64))
    squares = [
        posture_squares(problem.system.tree, problem.poses(own, t), weights[t], problem.truth[t])[0]
        for t, own in enumerate(particles)
    ]
    return float(np.sqrt(np.mean(squares)))


def smoothing_table(jobs: Jobs, results: Results) -> list[Table]:
    """One row a run."""
    rows = []
    for job in jobs["smoothing"]:
        found, first = results[job.key], (job.system.name, person_of(job.scene.recording), job.scene.name, job.method.name)
        rows += [(*first, run, *found["errors"][n], found["ess_share"][n]) for n, run in enumerate(job.runs)]
    return [Table("smoothing", _COLUMNS, rows, _ABOUT)]


def gains(rows: Sequence[Mapping[str, Any]], name: str) -> Interval:
    """How much less the error of a smoother is than the filter's, %: means of people over their runs, and 95 % over people."""
    column = name.replace("-", "_")
    people = grouped(rows, lambda row: str(row["person"])).values()
    return mean_interval(
        [100 * (1 - np.mean([row[column] for row in own]) / np.mean([row["filter"] for row in own])) for own in people]
    )


def smoothing_pays(tables: Tables) -> str:
    """The part of the page on smoothing; empty without its table."""
    if "smoothing" not in tables:
        return ""
    rows = []
    for (system, method), own in grouped(tables["smoothing"].records(), lambda row: (row["system"], row["method"])).items():
        filtered = mean_interval(
            [float(np.mean([row["filter"] for row in each])) for each in grouped(own, lambda row: str(row["person"])).values()]
        )
        found = [gains(own, name) for name in ALGORITHMS[1:]]
        share = f"{np.mean([row['ess_share'] for row in own]):.2f}"
        verdicts = [gain.above(100 * MATTERS) for gain in found]
        cells = [f"{gain.text()}: {verdict}" for gain, verdict in zip(found, verdicts, strict=True)]
        people = str(len({row["person"] for row in own}))
        rows.append([system, method, people, str(len(own)), filtered.clipped(0).text(), *cells, share])
    columns = ("system", "filter", "people", "runs", "error, mm", *(f"{name}: less, %" for name in ALGORITHMS[1:]), "ESS / N")
    return (
        "Peursum et al. propose to try smoothing with another learned motion. Here it is this one. Smoothing pays if it takes "
        f"away more than {100 * MATTERS:.0f} % of the error, by the 95 % interval over people.\n\n{markdown(columns, rows)}"
    )
