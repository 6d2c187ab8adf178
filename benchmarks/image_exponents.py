"""Peursum's section 6.1: is an annealed filter better than a plain one whose likelihood is sharpened enough?

    POSEPPL_DATA=FOLDER python benchmarks/image_exponents.py [--scenes FOLDER] [--output FILE] [--frames 40] [--runs 10]
                    [--exponents 10,30,60,120] [--systems peursum-measured,peursum] [--evaluations 10000] [--kind clean]
                    [--quick]

The paper calls an annealed filter and a plain one with P(y | x) = lambda exp(-lambda D), lambda = 10, alike. Its D is told in a
report alone and ours has a scale of its own, so that lambda = 10 here need not be 10 there: lambda is swept, and ESS / N, which
does not depend on the scale of D, stands beside it (section 6.2 tells 0.05 to 0.2). The annealed filter chooses its exponents
by a survival rate, so lambda does not change it, and it is run once. Both have the same number of evaluations.

Scenes, bodies and errors are those of image_runs.py. One row a run is written as it ends: a run is a seed. Runs that the file
holds already are not computed again.
"""

from __future__ import annotations

import csv
from functools import partial
from pathlib import Path

import jax
import numpy as np
from image_runs import scene_of
from image_systems import Problem, peursum
from image_tracks import FIGURES, first_state, track
from timing import arguments

from poseppl.cli.console import start_jax
from poseppl.experiments.tables import Table, write_csv
from poseppl.filters import annealed_filter, particle_filter

COLUMNS = ("diffusion", "scene", "frames", "filter", "exponent", "run", *FIGURES, "ess_share", "seconds")
BUILDERS = {"peursum": partial(peursum), "peursum-measured": partial(peursum, measured=True)}
LAYERS = 10


def main() -> None:
    options = arguments(
        __doc__,
        frames=40,
        runs=10,
        cameras=4,
        evaluations=10_000,
        exponents="10,30,60,120",
        systems="peursum-measured,peursum",
        kind="clean",
        scenes="scenes",
        output="image_exponents.csv",
    )
    start_jax()
    path = Path(options.output)
    frames, runs, count = (4, 1, 200) if options.quick else (options.frames, options.runs, options.evaluations)
    seen = scene_of(Path(options.scenes), options.kind, options.quick, frames)
    exponents = [float(word) for word in options.exponents.split(",")]
    rows = known_rows(path)
    done = {row[:6] for row in rows}
    problems = {
        (system, exponent): BUILDERS[system](seen, options.cameras, 1.0, exponent=exponent)[0]
        for system in options.systems.split(",")
        for exponent in exponents
    }
    steps = {}
    for run in range(runs):
        for (system, exponent), problem in problems.items():
            for name, filter in filters(problem, count, exponent == exponents[0]).items():
                told = "" if name.startswith("Simple-APF") else f"{exponent:g}"
                head = (system, seen.name, str(frames), name, told, str(run))
                if head in done:
                    continue
                step = steps.setdefault((system, exponent, name), jax.jit(filter.step))
                found = track(problem, step, first_state(problem, filter, run), run)
                errors = np.mean(found["errors"][1:], 0)
                row = (
                    *head,
                    *map(float, errors),
                    float(np.mean(found["ess_share"][1:])),
                    float(np.median(found["seconds"][1:])),
                )
                rows.append(row)
                write_csv(Table(path.stem, COLUMNS, rows), path.parent)
                print(*row[:6], *(f"{value:.3g}" for value in row[6:]), flush=True)


def filters(problem: Problem, count: int, annealed: bool) -> dict[str, object]:
    """The plain filter, and with the first exponent the annealed one."""
    built = {f"Simple-PF, {count:,}": particle_filter(problem.model, count)}
    if annealed:
        each = count // LAYERS
        built[f"Simple-APF, {LAYERS} x {each:,}"] = annealed_filter(problem.model, each, num_layers=LAYERS)
    return built


def known_rows(path: Path) -> list[tuple[object, ...]]:
    """Rows of an earlier call."""
    if not path.exists():
        return []
    with path.open() as file:
        return [(*row[:6], *map(float, row[6:])) for row in list(csv.reader(file))[1:]]


if __name__ == "__main__":
    main()
