"""What papers on tracking in images ran, on rendered scenes with truth: errors of fifteen virtual markers, and seconds a frame.

    POSEPPL_DATA=FOLDER python benchmarks/image_runs.py [--scenes FOLDER] [--output FOLDER] [--frames 40] [--runs 3]
                    [--systems peursum,peursum-measured,darby,du-guan] [--cameras 4] [--kinds clean,clutter]
                    [--filters WORD] [--quick]

Scenes: CMU's walk 02_01 at 30 Hz in a room with a camera in every corner, with and without furniture in the way; they are
rendered once into --scenes. Systems and their sources: image_systems.py. --cameras is for the two systems of several cameras;
Eq. 9 and Du and Guan see the first camera alone. --filters takes those with a word in their name. --quick takes the built-in
walk, the last filter of each system and a hundredth of its particles.

Errors are mm, the mean of each run's mean over frames, +- standard deviation over runs (seeds); frame 0 is where a run starts.
They are those of the particles' mean (absolute, relative), the mean of the particles' relative errors by weight, and that of
the best particle (poseppl.diagnostics.marker_errors). "weight" is the average sample weight of Du and Guan: the mean of the
likelihood over the particles. Two trackers that see nothing frame the numbers: one holds the first pose, the other is told the
truth and takes the body's closest pose. Seconds are the median frame's, without features and compilation.
A table is printed, and written as OUTPUT/image_runs_SYSTEM.csv row by row.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
from image_scene import Seen, rendered, see
from image_systems import SYSTEMS, Problem
from image_tracks import FIGURES, first_state, score, track
from timing import arguments, show

from poseppl.cli.console import start_jax
from poseppl.diagnostics import over_runs
from poseppl.experiments.tables import Table, write_csv

COLUMNS = ("system", "scene", "cameras", "frames", "runs", "method", "evaluations")
COLUMNS += tuple(name + end for name in FIGURES for end in ("", "_sd")) + ("seconds", "weight", "weight_sd", "failed")


def main() -> None:
    options = arguments(
        __doc__,
        frames=40,
        runs=3,
        cameras=4,
        systems="peursum,peursum-measured,darby,du-guan",
        kinds="clean,clutter",
        scenes="scenes",
        output="image-runs",
        filters="",
    )
    start_jax()
    quick, output, tables = options.quick, Path(options.output), []
    output.mkdir(parents=True, exist_ok=True)
    kinds = ["clean"] if quick else options.kinds.split(",")
    scenes = [scene_of(Path(options.scenes), kind, quick, 5 if quick else options.frames) for kind in kinds]
    for system in options.systems.split(","):
        tables.append(Table(f"image_runs_{system}", COLUMNS, []))
        for seen in scenes if system != "du-guan" else scenes[:1]:
            for problem in SYSTEMS[system](seen, options.cameras, 0.01 if quick else 1.0):
                chosen = [(name, build) for name, build in problem.filters.items() if options.filters in name]
                filters = dict(chosen[-1:] if quick else chosen)
                for row in measure(problem._replace(filters=filters), 1 if quick else options.runs):
                    tables[-1].rows.append(row)
                    write_csv(tables[-1], output)
    for table in tables:
        present(table)


def scene_of(folder: Path, kind: str, quick: bool, frames: int) -> Seen:
    furniture = ["--clutter" if kind == "clutter" else "--no-clutter"]
    if quick:
        return see(rendered(folder, f"quick-{kind}", ["--frames", f":{frames}", "--size", "320", "240", *furniture]), frames)
    data = Path(os.environ.get("POSEPPL_DATA", "../shared/data")) / "cmu_amc"
    recording = [str(data / "02_01.amc"), "--skeleton", str(data / "02.asf"), "--frames", "0:160:4"]
    return see(rendered(folder, f"walk-{kind}", [*recording, *furniture]), frames)


def measure(problem: Problem, runs: int) -> Iterator[tuple[Any, ...]]:
    """A row for each filter, after one for each tracker that sees nothing."""
    seen, frames = problem.seen, len(problem.frames)
    head = (problem.system, seen.name, problem.views, frames, runs)
    for name, states in (("(holds the first pose)", problem.fitted[:1].repeat(frames, 0)), ("(closest pose)", problem.fitted)):
        found = [score(problem, state[None], np.ones(1), frame) for frame, state in enumerate(states[:frames])]
        yield *head[:4], 1, name, 0, *figures([found]), float("nan"), float("nan"), float("nan"), 0
    for name, build in problem.filters.items():
        filter = build(problem.model)
        started = time.perf_counter()
        step = jax.jit(filter.step)
        jax.block_until_ready(
            step(jax.random.key(0), first_state(problem, filter, 0), problem.model.observe({}), problem.frames[0])
        )
        print(f"{problem.system}, {seen.name}, {name}: compiled in {time.perf_counter() - started:.0f} s", flush=True)
        tracks = []
        for seed in range(runs):
            tracks.append(track(problem, step, first_state(problem, filter, seed), seed))
            print(f"    run {seed + 1} of {runs}: absolute {np.mean(tracks[-1]['errors'], 0)[0]:.0f} mm", flush=True)
        weight = over_runs([np.mean(each["weight"]) for each in tracks])
        seconds = float(np.median([each["seconds"][1:] for each in tracks]))
        failed = sum(each["failed"] for each in tracks)
        row = (*head, name, tracks[0]["evaluations"], *figures([each["errors"] for each in tracks]), seconds, *weight, failed)
        yield row
        print(
            "   ", " ".join(f"{key} {row[COLUMNS.index(key)]:.3g}" for key in ("absolute", "relative", "optimistic", "seconds"))
        )


def figures(runs: list[list[list[float]]]) -> list[float]:
    """Mean and standard deviation over runs of each figure, without the frame where a run starts."""
    values = np.array(runs)[:, 1:]
    return [number for index in range(len(FIGURES)) for number in over_runs(values[:, :, index])]


def present(table: Table) -> None:
    """Print a table."""
    rows = []
    for row in table.rows:
        known = dict(zip(table.columns, row, strict=True))
        pairs = [_pair(known[name], known[f"{name}_sd"], 0) for name in FIGURES]
        shown = [_pair(known["weight"], known["weight_sd"], 3)] if np.isfinite(known["weight"]) else [""]
        label = ", ".join([*known["system"].split(", ")[1:], known["scene"]])
        numbers = [*pairs, f"{known['seconds']:.2f}", *shown]
        rows.append([label, str(known["cameras"]), known["method"], *numbers])
    columns = ["", "cameras", "method", "absolute", "relative", "weighted rel.", "optimistic", "s", "weight"]
    show(f"{table.name}: {table.rows[0][3]} frames, mm", columns, rows)


def _pair(mean: float, spread: float, digits: int) -> str:
    return f"{mean:.{digits}f}" + (f" +- {spread:.{digits}f}" if np.isfinite(spread) else "")


if __name__ == "__main__":
    main()
