"""Does the model know fast motion better than the filter? Modes of whole recordings, from the truth and from the filter.

    POSEPPL_DATA=FOLDER python -m studies.fast_motion_modes [--quick] [--recordings ...] [--frames 100] [--runs 3]
        [--output fast-motion]

Random-walk steps are learned from the recording (`--walk learned`). From the default tracker's means, and from the true states,
a search climbs to the nearest mode of the joint density of all frames. Each row is a recording and a seed: the log of the
Laplace mass of the mode from the truth minus that of the mode from the filter, and the mean joint errors of both, mm. A
negative value means that the most probable mode is farther from the truth. Rows in OUTPUT/fast_motion_modes.csv are reused.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.filters import assumed_density_filter
from poseppl.motion.measures import joint_error
from poseppl.motion.tracking import Scene
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.walk_learning import learn_walk
from poseppl.program import CompiledModel, Observation
from poseppl.runs.collectors import collect_draws
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.runs.run import run_filter
from poseppl.smoothers.curvature import find_mode, safe_cholesky, trajectory_precisions
from studies.fast_motion import RECORDINGS
from studies.kept_runs import keep_run, read_runs
from studies.random_walk import shared_problem, watch

COLUMNS = ("recording", "frames", "seed", "mass", "from_truth", "from_filter")
NUM_STEPS = 40
"""Gauss-Newton steps to a mode."""


@partial(jax.jit, static_argnums=0)
def mode_of(model: CompiledModel, start: Array, observations: Observation, inputs: Any) -> tuple[Array, Array]:
    """The mode (T, d) of a trajectory's density that is nearest to a start, and Laplace's log-mass, but for a constant."""
    mode = find_mode(model, start, observations, inputs, NUM_STEPS)
    inverses = safe_cholesky(trajectory_precisions(model, observations, inputs)(mode)).inverses
    volume = jnp.sum(jnp.log(jnp.diagonal(inverses, axis1=1, axis2=2)))
    return mode, model.log_joint(mode, observations, inputs) + volume


def study(model: CompiledModel, scene: Scene[PointData], seed: int) -> tuple[float, float, float]:
    """Log-mass of the mode from the truth less that from the filter, and errors of both, mm."""
    problem = learn_walk(shared_problem(scene, model))
    collect = collect_draws(model, max_draws=1)
    filter = assumed_density_filter(model)
    run = run_filter(filter, jax.random.key(seed), problem.observations, problem.inputs, collect=collect)
    sequence = frame_sequence(problem.observations, problem.inputs, None)
    seen = jax.tree.map(jnp.asarray, sequence.observations), sequence.stacked_inputs()
    found = [
        mode_of(model, jnp.asarray(start, jnp.float32), *seen) for start in (scene.states, run.outputs.summary["state_mean"])
    ]
    errors = [float(np.nanmean(joint_error(scene.body.places(mode), scene.markers).absolute)) for mode, _ in found]
    return float(found[0][1] - found[1][1]), *errors


def main() -> None:
    options = arguments(__doc__, recordings=RECORDINGS, frames=100, runs=3, output="fast-motion")
    start_jax()
    frames, runs = (5, 1) if options.quick else (options.frames, options.runs)
    rows = read_runs(options.output / "fast_motion_modes.csv")
    table = Table("fast_motion_modes", COLUMNS, rows, "Modes of fast_motion_modes.py: log-mass of the truth's, errors in mm.")
    done, model = {tuple(row[:3]) for row in table.rows}, None
    for name in options.recordings.split(","):
        for seed, scene in enumerate(watch(DATA, name, 1, frames, runs).scenes):
            model = model or shared_problem(scene, None).model
            key = (name, str(len(scene.frames)), str(seed))
            if key not in done:
                keep_run(table, (*key, *(f"{value:.5g}" for value in study(model, scene, seed))), options.output)
    show("Modes of whole recordings", list(COLUMNS), [list(map(str, row)) for row in table.rows])


if __name__ == "__main__":
    main()
