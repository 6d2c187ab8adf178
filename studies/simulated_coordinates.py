"""Which coordinates of simulated motion have intervals that are too narrow, and how wide is the posterior itself?

    python -m studies.simulated_coordinates [--quick] [--sequences 150] [--references 30] [--output simulated-coordinates]

The sequences of simulated_motion.py, one camera. The study compares the 25th frame by the default, the "nearly exact" filter,
and filters with chains of 200 updates of 12 steps with NUTS on all frames at once. NUTS has four chains that start at the
default's draws, or at the truth. Filter and smoother have the same posterior of the last frame. Chains that start at the truth
know at least the mode in which it lies, so that their errors may be too small; their deviations are not too large. Each row has
a sequence, method and part: share of the angles in central 90 % intervals, root mean squares of the claimed deviations and of
the errors (rad). Rows go to simulated_coordinates.csv in the folder, and what is there is not run again.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.choo_fleet.sequence import true_states
from poseppl_papers.choo_fleet.systems import SIMULATED, Stage, noisy_points, pose_sequence, stage_of
from poseppl_papers.tables import Table

from benchmarks.timing import arguments, show
from poseppl.motion.tracking.problem import Problem
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.run import run_filter
from poseppl.smoothers import History, collect_history, trajectory_smoother
from studies.kept_runs import keep_run, read_runs
from studies.simulated_motion import LONG_CHAINS, SETTINGS

PARTS = {"trunk": ("spine.Z", "spine.Y", "spine.X", "pelvis", "girdle"), "head": ("head",)}
"""Beginnings of the names of angles; all others are those of the limbs."""
DEFAULT, EXACT, SMOOTHED, NUTS = "default", "nearly exact", "default, then NUTS", "NUTS from the truth"
LONG, LONG_MANY = "long chains", "long chains, 12 Gaussians"
LEVEL, CHAINS = 0.9, 4
FILTERED = {name: SETTINGS[name] for name in (DEFAULT, EXACT, LONG_MANY)} | {LONG: LONG_CHAINS}
COLUMNS = ("method", "sequence", "part", "inside", "deviation", "error")
_ABOUT = "Of the last frame: share of angles in 90 % intervals, root mean squares of claimed deviations and of errors, rad."


def angles(stage: Stage) -> dict[str, list[int]]:
    """Indices of the state's angles by part of the body."""
    tree = stage.body.tree
    names = [tree.coordinate_names[index] for index in stage.body.free_coordinates]
    parts: dict[str, list[int]] = {part: [] for part in (*PARTS, "limbs")}
    for index, name in enumerate(names):
        if not name.startswith("spine.t"):
            parts[next((part for part, starts in PARTS.items() if name.startswith(starts)), "limbs")].append(index)
    return parts


def filtered(name: str, problem: Problem, sequence: int, count: int) -> History:
    """History of a filter."""
    built, _ = FILTERS["assumed-density"].build(problem.model, dict(FILTERED[name]))
    key = jax.random.key(sequence)
    run = run_filter(built, key, problem.observations, problem.inputs, num_frames=count, collect=collect_history)
    return History(*jax.tree.map(jnp.asarray, run.outputs))


def at_truth(truth: np.ndarray) -> History:
    """The history of a filter that knows the truth (T, d)."""
    shape = len(truth), CHAINS
    return History(
        jnp.broadcast_to(jnp.asarray(truth, jnp.float32)[:, None], (*shape, truth.shape[1])),
        jnp.full(shape, -np.log(CHAINS), jnp.float32),
        jnp.broadcast_to(jnp.arange(CHAINS), shape),
        jnp.zeros(len(truth), bool),
    )


@cache
def _sampler(model: CompiledModel) -> Any:
    smoother = trajectory_smoother(model, num_chains=CHAINS, num_draws=200, num_warmup=150, num_mode_steps=0, num_curvatures=8)
    return jax.jit(smoother.smooth)


def last_frame(method: str, problem: Problem, truth: np.ndarray, sequence: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws (N, d) of the last frame and normalised weights (N,), given the truth (T, d)."""
    count, dimension = truth.shape
    begun = method if method in FILTERED else DEFAULT
    history = at_truth(truth) if method == NUTS else filtered(begun, problem, sequence, count)
    if method in FILTERED:
        return np.asarray(history.particles[-1], float), np.exp(np.asarray(history.log_weights[-1], float))
    inputs = frame_sequence(problem.observations, problem.inputs, count).stacked_inputs()
    found = _sampler(problem.model)(jax.random.key(sequence), history, problem.observations, inputs)
    draws = np.asarray(found.particles[-1], float).reshape(-1, dimension)
    return draws, np.full(len(draws), 1 / len(draws))


def inside(draws: np.ndarray, weights: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Whether each true coordinate (d,) lies in the central interval of weighted draws (N, d)."""
    below = np.sum(weights[:, None] * (draws < truth), 0)
    return np.abs(below - 0.5) < LEVEL / 2


def study(method: str, sequence: int, count: int) -> list[tuple[Any, ...]]:
    """The rows of a sequence."""
    stage, shown = stage_of(SIMULATED, "full_body", sequence), slice(1, 1 + count)
    problem, truth = pose_sequence(stage, shown, noisy_points(stage, shown, sequence)), true_states(stage, shown)
    draws, weights = last_frame(method, problem, truth, sequence)
    mean = weights @ draws
    values = inside(draws, weights, truth[-1]), weights @ (draws - mean) ** 2, (mean - truth[-1]) ** 2
    rows = []
    for part, indices in angles(stage).items():
        hits, variance, squared = (float(np.mean(value[indices])) for value in values)
        rows.append((method, str(sequence), part, *(f"{value:.4g}" for value in (hits, variance**0.5, squared**0.5))))
    return rows


def main() -> None:
    """Run all methods on the same sequences."""
    options = arguments(__doc__, sequences=150, references=30, output="simulated-coordinates")
    most, fewer, count = (1, 1, 4) if options.quick else (options.sequences, options.references, 25)
    table = Table("simulated_coordinates", COLUMNS, read_runs(options.output / "simulated_coordinates.csv"), _ABOUT)
    done = {tuple(row[:2]) for row in table.rows}
    several = min(most, 2 * fewer)
    numbers = {DEFAULT: most, EXACT: fewer, LONG: several, LONG_MANY: several, SMOOTHED: fewer, NUTS: fewer}
    for method, number in numbers.items():
        for sequence in range(number):
            if (method, str(sequence)) not in done:
                *others, last = study(method, sequence, count)
                table.rows.extend(others)
                keep_run(table, last, options.output)
    shown = []
    for method, part in dict.fromkeys((row[0], row[2]) for row in table.rows):
        own = np.array([row[3:] for row in table.rows if (row[0], row[2]) == (method, part)], float)
        deviation, error = np.sqrt(np.mean(own[:, 1:] ** 2, 0))
        shown.append([method, part, f"{100 * own[:, 0].mean():.0f}", f"{deviation:.3f}", f"{error:.3f}"])
    show("The last frame of simulated motion", ("method", "part", "in 90 %", "deviation", "error"), shown)


if __name__ == "__main__":
    main()
