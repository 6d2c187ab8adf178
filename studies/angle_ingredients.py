"""Which of what is not known makes intervals of angles too narrow: the segment lengths, the cameras, or neither?

    POSEPPL_DATA=FOLDER python -m studies.angle_ingredients [--quick] [--cameras 4] [--cases ...] [--recordings ...]
        [--output angle-ingredients]

People of simulated_keypoints.py without clutter and exchanged limbs are smoothed with the truth as start, so that neither a
filter nor a search has an influence. Lengths are measured in the points or those of the person, and cameras are refined or
exact; noise is that of the points. Errors and deviations, degrees, are medians over frames, then means over the angles that
keypoints determine. Runs in the table in OUTPUT are not made again.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from poseppl_papers.tables import Table, shown

from benchmarks.timing import DATA, arguments
from poseppl.arrays import Floats
from poseppl.cli.console import start_jax
from poseppl.compilation import jit
from poseppl.motion.bodies.body import Body, body_builder
from poseppl.motion.bodies.opensim import circular_summary, opensim_coordinates, states_to_values
from poseppl.motion.bodies.subject import MovingSubject
from poseppl.motion.geometry.cameras import triangulate
from poseppl.motion.keypoints.camera_refinement import bundle_adjust
from poseppl.motion.keypoints.drawn_detections import CALIBRATION, detect
from poseppl.motion.keypoints.scene import noise_of_points, with_markers
from poseppl.motion.keypoints.sources import points_of
from poseppl.motion.tracking.body_sizes import MeasuredLengths, lengths_per_place, measured_lengths
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.lasting_errors import with_ar1_noise, with_no_errors
from poseppl.motion.tracking.placing import cameras_of_records
from poseppl.motion.tracking.point_data import PointData
from poseppl.motion.tracking.problem import Problem, make_problem
from poseppl.motion.tracking.recorded_model import offsets_of_lengths
from poseppl.motion.tracking.scene import Scene
from poseppl.runs.frame_sequence import frame_sequence
from poseppl.smoothers.base import History
from poseppl.smoothers.laplace import cut_laplace_smoother, laplace_smoother
from studies.kept_runs import keep_run, read_runs
from studies.laboratory_rig import RIG, rig_records
from studies.simulated_keypoints import LEVELS, OPENSIM, WALKS, ideal_deviations, recorded

CASES: Mapping[str, tuple[bool, bool]] = {
    "all known": (False, False),
    "cameras corrected": (False, True),
    "lengths measured": (True, False),
    "both": (True, True),
}
"""Whether lengths are measured, and whether cameras are off."""
COLUMNS = ("recording", "cameras", "case", "error", "deviation", "coverage_50", "coverage_90")
TOLD, DRAWS = 12.0, 200
"""Degrees to within which keypoints have to tell an angle; draws of trajectories."""


def posed(subject: MovingSubject, num_cameras: int, measured: bool, off: bool, seed: int) -> Problem:
    """The problem of a person's points, as smoothing poses it."""
    records = [rig_records(DATA)[c] for c in RIG[num_cameras]]
    rng = np.random.default_rng([seed, num_cameras])
    people = detect(subject, records, rng, calibration=CALIBRATION if off else 0.0, clutter=False, exchange=False).people
    cameras, build, markers = cameras_of_records(records), body_builder(DEFAULT_MODEL), subject.body.tree.marker_names
    frames = np.arange(len(subject.frames))
    points, sure = points_of(
        [with_markers(each, markers) for each in people.values()], np.zeros((len(frames), num_cameras), int)
    )
    noise = subject.body.noise * float(np.mean(cameras.focal))
    refined = bundle_adjust(cameras, points, sure, noise, subject.rate) if off else None
    cameras = cameras if refined is None else refined.cameras
    places = triangulate(cameras, points, sure)
    body = build(measured_lengths(subject.body, places)) if measured else subject.body
    spread = noise_of_points(body.noise, body, cameras, np.full(num_cameras, noise), places, sure)
    scene = Scene(body, cameras, tuple(people), PointData(points, spread), frames, subject.rate, "")
    lengths = MeasuredLengths(offsets_of_lengths(body, build), lengths_per_place(body, places)) if measured else None
    covariance = None if refined is None else refined.covariance
    return with_ar1_noise(make_problem(scene), frames, subject.rate, covariance, lengths)


def smoothed_poses(problem: Problem, states: Floats) -> Floats:
    """Draws (S, T, d) of the pose, from the mode nearest to states (T, d)."""
    count, static = len(states), problem.num_static
    weights = jnp.zeros((count, 1))
    history = History(jnp.asarray(states, float)[:, None], weights, weights.astype(int), weights[:, 0] > 0)
    model = problem.model
    smoother: Any = cut_laplace_smoother(model, static, num_draws=DRAWS) if static else laplace_smoother(model, num_draws=DRAWS)
    sequence = frame_sequence(problem.observations, problem.inputs, None)
    data = jax.tree.map(jnp.asarray, sequence.observations), sequence.stacked_inputs()
    found = jit(smoother.smooth)(jax.random.key(0), with_no_errors(history, problem), *data)
    return np.swapaxes(np.asarray(found.particles), 0, 1)[..., : states.shape[1]]


def row(subject: MovingSubject, body: Body, draws: Floats) -> tuple[float, ...]:
    """Median error and deviation, and shares in intervals, means over the angles that keypoints determine."""
    values = np.asarray(states_to_values(body, jnp.asarray(draws, float)), np.float64)
    truth = np.asarray(states_to_values(subject.body, jnp.asarray(subject.states, float)[None]), np.float64)[0]
    turning = np.array([each.unit == "degrees" for each in opensim_coordinates(body)])
    ideal = ideal_deviations(subject)
    informed = np.flatnonzero(turning & (ideal > 0.01) & (ideal <= TOLD))
    ends = tuple(end for level in LEVELS for end in ((1 - level) / 2, (1 + level) / 2))
    mean, deviation, between = circular_summary(values[..., informed], ends)
    off = (truth[:, informed] - mean + 180) % 360 - 180
    inside = [np.mean((off >= low - mean) & (off <= high - mean)) for low, high in (between[:2], between[2:])]
    return float(np.median(np.abs(off), 0).mean()), float(np.median(deviation, 0).mean()), *map(float, inside)


def main() -> None:
    """Run what is not yet in OUTPUT/angle_ingredients.csv."""
    options = arguments(__doc__, cameras="4", cases=",".join(CASES), recordings="", output="angle-ingredients")
    start_jax()
    path = options.output / "angle_ingredients.csv"
    table = Table("angle_ingredients", COLUMNS, read_runs(path))
    recordings = options.recordings.split(",") if options.recordings else [*WALKS, OPENSIM]
    runs = list(itertools.product(options.cases.split(","), options.cameras.split(","), recordings))
    for case, cameras, name in runs[: 1 if options.quick else None]:
        if (name, cameras, case) in {kept[:3] for kept in table.rows}:
            continue
        seed = [*WALKS, OPENSIM].index(name)
        subject = recorded(DATA, name, seed)
        problem = posed(subject, int(cameras), *CASES[case], seed)
        numbers = row(subject, problem.body, smoothed_poses(problem, subject.states))
        keep_run(table, tuple(map(shown, (name, cameras, case, *numbers))), options.output)


if __name__ == "__main__":
    main()
