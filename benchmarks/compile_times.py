"""Cost of each filter and smoother on the 28-DOF body: compilation, a run without it, and memory.

    python -m benchmarks.compile_times [--quick] [--frames 5] [--only switching] [--output compile-times]

Two cameras see the built-in walk. Every algorithm of `poseppl filters` and `poseppl smoothers` runs at its defaults in a
process of its own, without a compile cache, one process at a time. The largest memory is that of the process; compare it with a
process that only loaded the libraries ("none"). Compilation is the difference in processor seconds between a first run and an
equal second one, and so includes tracing. A run is `track` with its draws, quantiles and predictive checks, or `smooth` of a
filter's result from a file. With a prior, the activity is learned from the walk itself. The filter of hidden Markov models has
no body. Algorithms in OUTPUT are reused, except those of --only.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from poseppl_papers.tables import Table, read_folder

from benchmarks.timing import arguments, peak_memory, show, write_table
from poseppl.motion.learned import PosedRecording, TrainingSettings, train_motion_model, write_motion_model
from poseppl.motion.recordings.subjects import walking_subject
from poseppl.motion.tracking import SmoothSettings, TrackSettings, observe_motion, smooth, track
from poseppl.motion.tracking.default_body import DEFAULT_MODEL
from poseppl.motion.tracking.placing import camera_names, cameras_around
from poseppl.runs.algorithms import FILTERS, SMOOTHERS
from poseppl.runs.results import load_result, save_result

NAME, PRIOR, NUM_CAMERAS = "compile_times", "walk.nc", 2
_FILTER_OF = {"genealogy": "particle", "fixed-lag": "particle"}
_NOISE = 0.05
"""Noise of the poses for learning an activity, radians and mm; without it they are alike in each round of the walk."""
_COLUMNS = ("kind", "name", "settings", "compilation", "run", "memory")
_ABOUT = "Processor seconds by which a first run takes longer than a second one, and of the second; largest memory, MiB."


class Case(NamedTuple):
    """An algorithm, and what is not at its default: settings, and whether the walk's activity is the prior."""

    kind: str
    name: str
    options: dict[str, Any]
    prior: bool = False

    @property
    def key(self) -> tuple[str, str, str]:
        """Its key in the table."""
        words = [f"{name}={value}" for name, value in self.options.items()]
        return self.kind, self.name, ", ".join([*words, *(["prior"] if self.prior else [])])


def cases() -> Iterator[Case]:
    """All, the libraries alone first."""
    yield Case("none", "", {})
    yield from (Case("filter", name, {}, name == "activity-guided") for name in FILTERS if name != "hidden-markov")
    yield from (Case("filter", name, {}, prior=True) for name in ("switching", "guided"))
    yield Case("filter", "particle", {"num_particles": 100_000})
    yield from (Case("smoother", name, {}) for name in SMOOTHERS)


def measure(case: Case, num_frames: int, folder: Path, answer: Any) -> None:
    """Run one algorithm twice; send processor seconds of compilation and of a run, and the largest memory in MiB."""
    if case.kind == "none":
        answer.put((0.0, 0.0, peak_memory()))
    elif case.kind == "smoother":
        tree = load_result(folder / f"{_filter_of(case)}.nc")
        answer.put(_twice(partial(smooth, tree, SmoothSettings(case.name))))
    else:
        answer.put(_twice(partial(track_walk, case, num_frames, folder)))


def track_walk(case: Case, num_frames: int, folder: Path) -> Any:
    """The result of a filter, with the file of the prior in the folder."""
    subject = walking_subject(frames=f"0:{num_frames}")
    scene = observe_motion(subject, cameras_around(subject, count=NUM_CAMERAS), camera_names(NUM_CAMERAS))
    prior = str(folder / PRIOR) if case.prior else None
    return track(
        scene, TrackSettings(filter=case.name, options=case.options, prior=prior, other_motion=case.name != "activity-guided")
    ).result


def prepare(case: Case, num_frames: int, folder: Path) -> None:
    """Write what the algorithm takes, if it is not there: the prior, or the result of the smoother's filter."""
    if case.prior and not (folder / PRIOR).exists():
        learn_walk(folder / PRIOR)
    if case.kind == "smoother" and not (path := folder / f"{_filter_of(case)}.nc").exists():
        save_result(track_walk(Case("filter", _filter_of(case), {}), num_frames, folder), path)


def learn_walk(path: Path) -> None:
    """Learn the built-in walk, each pose with noise, as an activity, as `poseppl fit-motion` does by default, and write it."""
    subject = walking_subject(frames="0:240")
    tree, noise = subject.body.tree, np.random.default_rng(0).normal(0.0, _NOISE, subject.states.shape)
    recording = PosedRecording(
        subject.states + noise, tree.coordinate_names, tree.joint_names[0], subject.rate, "walk", "walk", 0.0
    )
    write_motion_model(train_motion_model([recording], DEFAULT_MODEL, TrainingSettings()), path)


def _filter_of(case: Case) -> str:
    return _FILTER_OF.get(case.name, "kalman")


def _twice(run: Callable[[], Any]) -> tuple[float, float, float]:
    seconds = []
    for _ in range(2):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return seconds[0] - seconds[1], seconds[1], peak_memory()


def measured(case: Case, num_frames: int, folder: Path) -> tuple[float, ...]:
    """Result of :func:`measure` in a process of its own."""
    prepare(case, num_frames, folder)
    context = multiprocessing.get_context("spawn")
    answer = context.Queue()
    process = context.Process(target=measure, args=(case, num_frames, folder, answer))
    process.start()
    process.join()
    if process.exitcode:
        raise SystemExit(f"{' '.join(case.key)} failed")
    found: tuple[float, ...] = answer.get()
    return found


def main() -> None:
    options = arguments(__doc__, frames=5, only="", output="compile-times")
    folder, known = options.output, list(cases())
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "0"  # of the processes; what they import compiles already
    wanted = [case for case in known if options.only in ("", case.name)]
    kept = read_folder(folder).get(NAME)
    rows = {} if kept is None else {tuple(row[:3]): row for row in kept.table.rows}
    with TemporaryDirectory() as scratch:
        for case in wanted[:2] if options.quick else wanted:
            if case.key in rows and not options.only:
                continue
            rows[case.key] = (*case.key, *measured(case, 3 if options.quick else options.frames, Path(scratch)))
            print(*rows[case.key], flush=True)
            table = Table(NAME, _COLUMNS, [rows[each.key] for each in known if each.key in rows], _ABOUT)
            write_table(table, folder, "1", "built-in walk, two cameras")
    columns = ["", "", "settings", "compilation, processor s", "run, processor s", "memory, MiB"]
    shown = [[*row[:3], f"{row[3]:.1f}", f"{row[4]:.1f}", f"{row[5]:,.0f}"] for row in rows.values()]
    show("28-DOF body, two cameras", columns, shown)


if __name__ == "__main__":
    main()
