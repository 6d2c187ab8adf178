"""Losses of the default tracker with fast motion in one camera, and remedies.

    POSEPPL_DATA=FOLDER python -m studies.fast_motion [--quick] [--recordings ...] [--cases ...] [--frames 100] [--runs 3]
        [--output fast-motion]

A case is a walk, and further differences from the default:

* fixed, learned: the published steps, and the most likely steps (`--walk learned`);
* mean-reverting: angles revert to the usual posture, the rest is learned (`--walk mean-reverting`);
* one translation: learned steps, of which the root's translations share their root mean square;
* fitted: points of the body's own states instead of the recorded joints, so that limits of the body cost nothing;
* more chains: 60 chains instead of 30, 160 climbs to modes instead of 40, 6 Gaussians instead of 3;
* root velocity: published angles, and a root whose velocity is part of the state: 2 m/s, kept for a second, and 8 mm beside.

Errors are mean distances of posterior means of the joints from the truth, mm; coverage is that of 90 % intervals of the joints'
coordinates. Noise and filter differ between runs by their seed, and are the same in all cases. Mean and standard deviation over
runs; those that OUTPUT/fast_motion.csv holds are not made again.
"""

from __future__ import annotations

import statistics
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show
from poseppl.cli.console import start_jax
from poseppl.filters import assumed_density_filter
from poseppl.motion.bodies.body import BodyInputs
from poseppl.motion.geometry import marker_positions, project
from poseppl.motion.likelihoods import ProjectedMarkers
from poseppl.motion.tracking import Problem, Scene, make_problem
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import body_inputs, with_steps
from poseppl.motion.tracking.walk import ASSUMED_RATE, time_steps
from poseppl.motion.tracking.walk_learning import learn_walk
from poseppl.program import StateSpaceModel
from poseppl.runs.collectors import collect_draws
from poseppl.runs.run import frame_inputs, run_filter
from studies.kept_runs import keep_run, read_runs
from studies.random_walk import measured, watch

RECORDINGS = "run,02_03 at 30,02_04 at 30,dance_a,dance_b"
CASES = (
    "fixed,learned,mean-reverting,learned one translation,"
    "fixed fitted,learned fitted,mean-reverting fitted,learned more chains,root velocity"
)
MORE = {"num_chains": 60, "num_starts": 160, "num_components": 6}
PACE, MEMORY, JITTER = 2000.0, 1.0, 8.0
"""Velocity of the root: its standard deviation, mm/s, its time constant, s, and further motion in 1/30 s, mm."""
_COLUMNS = ("recording", "rate", "case", "frames", "seed", "error", "coverage")


class MovingInputs(NamedTuple):
    """Inputs of a body whose root has a velocity: the body's own, steps of the pose (d,), seconds, and what velocities keep."""

    body: BodyInputs
    step_scale: jax.Array
    seconds: jax.Array
    kept: jax.Array


def _initial(params: Any, inputs: MovingInputs) -> None:
    numpyro.sample("pose", dist.Normal(inputs.body.start, inputs.body.start_scale))
    numpyro.sample("velocity", dist.Normal(jnp.zeros(3), PACE))


def _transition(params: Any, state: Any, inputs: MovingInputs) -> None:
    moved = state["pose"].at[:3].add(inputs.seconds * state["velocity"])
    numpyro.sample("pose", dist.Normal(moved, inputs.step_scale))
    numpyro.sample("velocity", dist.Normal(inputs.kept * state["velocity"], PACE * jnp.sqrt(1 - inputs.kept**2)))


def _observation(params: Any, state: Any, inputs: MovingInputs) -> None:
    body = inputs.body
    numpyro.sample("points", ProjectedMarkers(body.tree, body.cameras, state["pose"], body.noise))
    numpyro.deterministic("markers", marker_positions(body.tree, state["pose"]))


MOVING = StateSpaceModel(_initial, _transition, _observation)


def moving(problem: Problem, scene: Scene[PointData]) -> Problem:
    """The problem of a body whose root has a velocity."""
    seconds = time_steps(scene.frames, scene.rate)
    steps = np.array(body_inputs(problem.inputs).step_scale)
    steps[:, :3] = JITTER * np.sqrt(ASSUMED_RATE * seconds)[:, None]
    per_frame = (jnp.asarray(each, jnp.float32) for each in (steps, seconds, np.exp(-seconds / MEMORY)))
    inputs: Any = MovingInputs(problem.inputs, *per_frame)
    model = MOVING.compile(inputs=frame_inputs(inputs, 0))
    return problem._replace(model=model, inputs=inputs, observations=model.observe({"points": scene.data.points}))


def one_translation(problem: Problem) -> Problem:
    """Steps of which those of the root's translations are one."""
    steps = body_inputs(problem.inputs).step_scale
    shared = jnp.sqrt(jnp.mean(steps[:, :3] ** 2, axis=1, keepdims=True))
    return problem._replace(inputs=with_steps(problem.inputs, steps.at[:, :3].set(shared)))


def fitted(scene: Scene[PointData], seed: int) -> Scene[PointData]:
    """Points of the body in its own states, with the same noise."""
    markers = scene.body.places(scene.states)
    points = np.asarray(jax.vmap(lambda each: project(scene.cameras, each))(jnp.asarray(markers, jnp.float32)), float)
    noise = scene.data.noise[None, ..., None] * np.random.default_rng(1000 + seed).normal(size=points.shape)
    return scene._replace(markers=markers, data=scene.data._replace(points=points + noise))


class Tracker:
    """The default tracker for all recordings and cases; a filter is compiled once for each model and setting."""

    def __init__(self) -> None:
        self.models: dict[tuple[bool, bool], Any] = {}

    def run(self, scene: Scene[PointData], case: str, seed: int) -> tuple[float, float]:
        """Error and coverage of a run."""
        seen = fitted(scene, seed) if "fitted" in case else scene
        problem = make_problem(seen, mean_reverting="reverting" in case)
        if "learned" in case or "reverting" in case:
            problem = learn_walk(problem)
        if "one translation" in case:
            problem = one_translation(problem)
        if "velocity" in case:
            problem = moving(problem, seen)
        model = self.models.setdefault(("velocity" in case, "reverting" in case), problem.model)
        filter = assumed_density_filter(model, **(MORE if "more chains" in case else {}))
        collect = collect_draws(model, max_draws=1)
        run = run_filter(filter, jax.random.key(seed), problem.observations, problem.inputs, collect=collect)
        return measured(seen, run.outputs.summary, None)


def main() -> None:
    options = arguments(__doc__, recordings=RECORDINGS, cases=CASES, frames=100, runs=3, output="fast-motion")
    start_jax()
    folder, output = DATA, options.output
    frames, runs = (5, 1) if options.quick else (options.frames, options.runs)
    rows = read_runs(output / "fast_motion.csv")
    table = Table("fast_motion", _COLUMNS, rows, "Runs of fast_motion.py: errors in mm, shares of the joints' coordinates.")
    tracker, done = Tracker(), {row[:5] for row in table.rows}
    watched = {name: watch(folder, name, 1, frames, runs).scenes for name in options.recordings.split(",")}
    for case in options.cases.split(","):
        for name, scenes in watched.items():
            for seed, scene in enumerate(scenes):
                key = (name, f"{scene.rate:g}", case, str(len(scene.frames)), str(seed))
                if key in done:
                    continue
                found = tracker.run(scene, case, seed)
                keep_run(table, (*key, *(f"{value:.5g}" for value in found)), output)
    show("Mean ± standard deviation over runs", [*_COLUMNS[:4], "error, mm", "coverage, %"], summed(table.rows))


def summed(rows: list[tuple[Any, ...]]) -> list[list[str]]:
    """Mean and standard deviation over seeds."""
    groups: dict[tuple[Any, ...], list[tuple[float, ...]]] = {}
    for row in rows:
        groups.setdefault(row[:4], []).append(tuple(map(float, row[5:])))
    shown = []
    for key, values in groups.items():
        error, coverage = zip(*values, strict=True)
        deviation = f" ± {statistics.stdev(error):.0f}" if len(error) > 1 else ""
        shown.append([*map(str, key), f"{statistics.mean(error):.0f}{deviation}", f"{100 * statistics.mean(coverage):.0f}"])
    return shown


if __name__ == "__main__":
    main()
