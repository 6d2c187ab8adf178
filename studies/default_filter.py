"""Which filter should `poseppl track` take by default: errors, coverage and speed on every recording of markers.

    POSEPPL_DATA=FOLDER python -m studies.default_filter [--quick] [--filters kalman,assumed-density] [--cameras 1,2]
        [--recordings NAMES] [--frames 100] [--seeds 1] [--output default-filter]

The built-in walk and the recordings of random_walk.py, their markers seen by one simulated camera and by two, with default
settings. Errors are mean distances of joints from the truth, mm. Coverage is that of the joints' 90 % intervals. Frames a
second are of a run without its compilation; filters run in turns. Runs that OUTPUT/default_filter.csv has are not made again.
The table in docs/validation/motion.md is made from studies/tables/default_filter.csv.
"""

from __future__ import annotations

import itertools
from typing import Any

import jax
from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, write_table
from poseppl.cli.console import start_jax
from poseppl.diagnostics import diagnose
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import TrackSettings, observe_motion
from poseppl.motion.tracking.metrics import measure_run
from poseppl.motion.tracking.placing import camera_names, place_cameras
from poseppl.motion.tracking.track import result_of_scene, walk_params
from poseppl.program import CompiledModel
from poseppl.runs.algorithms import FILTERS
from poseppl.runs.run import run_filter
from studies.kept_runs import keep_run, read_runs
from studies.random_walk import RECORDINGS, shared_problem, watch

NAME, BUILT_IN = "default_filter", "built-in walk"
_COLUMNS = ("filter", "cameras", "recording", "seed", "frames", "error", "coverage", "frames_per_second", "failed")
_KEY = 5
_ABOUT = "Mean joint error, mm, coverage of the joints' 90 % intervals, and frames a second without compilation."


class Contest:
    """Filters for so many cameras, each compiled once for all recordings."""

    def __init__(self, cameras: int) -> None:
        self.cameras = cameras
        self._model: CompiledModel | None = None
        self._built: dict[str, Any] = {}

    def run(self, filter: str, recording: str, seed: int, frames: int) -> tuple[float, ...]:
        """Error, coverage, frames a second, and frames with zero likelihood."""
        scene = self._scene(recording, seed, frames)
        problem = shared_problem(scene, self._model)
        self._model = problem.model
        if filter not in self._built:
            self._built[filter] = FILTERS[filter].build(problem.model, {})[0], problem.collector(50)
        built, collect = self._built[filter]
        run = run_filter(
            built, jax.random.key(seed), problem.observations, problem.inputs, num_frames=len(scene.frames), collect=collect
        )
        known = {"filter": filter, "settings": walk_params(scene.body, TrackSettings())}
        tree = result_of_scene(scene, problem, run, known)
        numbers = measure_run(diagnose(tree))
        assert numbers.joint_error is not None and numbers.coverage is not None
        return numbers.joint_error, numbers.coverage, len(scene.frames) / run.wall_seconds, numbers.failed

    def _scene(self, recording: str, seed: int, frames: int) -> Any:
        if recording != BUILT_IN:
            return watch(DATA, recording, self.cameras, frames, seed + 1).scenes[seed]
        walk = walking_subject(frames=f"0:{frames}")
        cameras = place_cameras(walk.markers[:, 0], 0.0, count=self.cameras)
        return observe_motion(walk, cameras, camera_names(self.cameras), seed=seed)


def main() -> None:
    """Print the runs and write them to OUTPUT."""
    names = ",".join([BUILT_IN, *RECORDINGS])
    options = arguments(
        __doc__, filters="kalman,assumed-density", cameras="1,2", recordings=names, frames=100, seeds=1, output="default-filter"
    )
    start_jax()
    frames, seeds = (5, 1) if options.quick else (options.frames, options.seeds)
    recordings = options.recordings.split(",")[: 2 if options.quick else None]
    table = Table(NAME, _COLUMNS, read_runs(options.output / f"{NAME}.csv"), _ABOUT)
    for cameras in map(int, options.cameras.split(",")):
        contest = Contest(cameras)
        for recording, seed, filter in itertools.product(recordings, range(seeds), options.filters.split(",")):
            key = (filter, str(cameras), recording, str(seed), str(frames))
            if key not in {tuple(row[:_KEY]) for row in table.rows}:
                numbers = contest.run(filter, recording, seed, frames)
                keep_run(table, (*key, *(f"{number:.5g}" for number in numbers)), options.output)
    write_table(table, options.output, f"{seeds} a recording", f"{len(recordings)}")


if __name__ == "__main__":
    main()
