"""Time one library on a job, in the environment that it is installed in, or all libraries in turn.

    python -m benchmarks.peers LIBRARY [--runs 7] [--table FILE.csv]
    python -m benchmarks.peers all --environments FOLDER [--turns 2] [--table FILE.csv]

A row has the lines of the library's file (with another library file that it imports) and the processor seconds of the first
run, imports and compilation included. The median seconds of later runs follow, and the error of the means in the job's units.
Processor time is that of all the process's threads; other work on the machine disturbs it less than the clock's. A library that
does not end its first run within `LIMIT` seconds gets a row without numbers. Libraries need not agree on what they build on, so
each has an environment of its own, FOLDER/LIBRARY; without a name, the libraries are listed. Names without a job are those of
the drifting level; others end in the job. `--table` appends the rows to a file: studies/tables/library_jobs.csv is made so.
"""

from __future__ import annotations

import argparse
import ast
import csv
import importlib
import os
import subprocess
import sys
import threading
import time
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import numpy as np

HERE = Path(__file__).resolve().parent
NAMES = [file.stem.removeprefix("with_") for file in sorted(HERE.glob("with_*.py"))]
COLUMNS = ("job", "library", "method", "lines", "first_seconds", "seconds", "error")
LIMIT = 300.0
"""Seconds by the clock of a first run."""


def count_lines(path: Path) -> int:
    """Lines of a file, and of files beside it that it imports, without blanks, comments, docstring and future imports."""
    source = path.read_text(encoding="utf-8")
    docstring = ast.parse(source).body[0].end_lineno or 0
    rest = [line.strip() for line in source.splitlines()[docstring:]]
    imported = (path.with_name(f"{line.split()[1]}.py") for line in rest if line.startswith(("import with_", "from with_")))
    own = sum(bool(line) and not line.startswith(("#", "from __future__")) for line in rest)
    return own + sum(count_lines(each) for each in imported)


def report(row: list[object], table: Path | None) -> None:
    """Print a row, and append it to a table."""
    print("|", " | ".join(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row), "|", flush=True)
    if table is None:
        return
    is_new = not table.exists()
    with table.open("a", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, row] if is_new else [row])


def measure(name: str, module: ModuleType, runs: int | None, table: Path | None) -> None:
    """Run one library and report its row."""
    job_name = getattr(module, "JOB", "job")
    job = importlib.import_module(job_name)
    data = job.draw()
    mean, deviation = job.exact(data)
    row: list[object] = [job_name.removeprefix("job_").replace("job", "level"), f"{module.NAME} {version(module.PACKAGE)}"]
    row += [module.METHOD, count_lines(HERE / f"with_{name}.py")]

    def give_up() -> None:
        report([*row, "", "", ""], table)
        os._exit(0)

    limit = threading.Timer(LIMIT, give_up)
    limit.start()
    began = time.process_time()
    run = module.prepare(data)
    run(0)
    first, seconds, errors = time.process_time() - began, [], []
    limit.cancel()
    for seed in range(1, 1 + (runs or getattr(job, "NUM_RUNS", 7))):
        began = time.process_time()
        found = np.asarray(run(seed))
        seconds.append(time.process_time() - began)
        errors.append(np.sqrt(np.mean(((found - mean) / deviation) ** 2)))
    report([*row, round(first, 3), round(float(np.median(seconds)), 6), round(float(np.mean(errors)), 5)], table)


def measure_all(environments: Path, turns: int, table: Path | None) -> None:
    """Run all libraries that have an environment, job by job, each in a process of its own, once in each turn."""
    installed = sorted((each.name for each in environments.iterdir()), key=len, reverse=True)
    by_job = sorted(NAMES, key=lambda name: _job_of(name))
    extra = [] if table is None else ["--table", str(table)]
    for _ in range(turns):
        for name in by_job:
            library = next((each for each in installed if name == each or name.startswith(f"{each}_")), None)
            if library is not None:
                python = environments / library / "bin" / "python"
                subprocess.run([python, "-W", "ignore", "-m", "benchmarks.peers", name, *extra], check=False)


def _job_of(name: str) -> str:
    source = (HERE / f"with_{name}.py").read_text(encoding="utf-8")
    line = next(line for line in source.splitlines() if line.startswith("NAME, PACKAGE, METHOD"))
    return str(ast.literal_eval(line.partition(" = ")[2])[-1]) if "JOB" in line else "job"


def main() -> None:
    """Run one library, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description="Jobs in several libraries.")
    parser.add_argument("library", nargs="?", help="all, or one of " + ", ".join(NAMES))
    parser.add_argument("--runs", type=int, help="timed runs after the first (default: 7; PMMH and SMC² 1)")
    parser.add_argument("--environments", type=Path, help="for all: the folder with an environment for each library")
    parser.add_argument("--turns", type=int, default=2, help="for all: how often")
    parser.add_argument("--table", type=Path, help="the CSV file to which rows are appended")
    given = parser.parse_args()
    if given.library is None:
        print(*NAMES, sep="\n")
    elif given.library == "all":
        if given.environments is None:
            parser.error("all needs --environments FOLDER")
        measure_all(given.environments, given.turns, given.table)
    else:
        table = None if given.table is None else given.table.resolve()
        sys.path[0] = str(HERE)
        measure(given.library, importlib.import_module(f"with_{given.library}"), given.runs, table)


if __name__ == "__main__":
    main()
