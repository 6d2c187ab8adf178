"""Time one library on a job, in the environment that it is installed in: python -m benchmarks.peers LIBRARY [--runs 20].

It prints the lines of the library's file (with another library file that it imports), the processor seconds of the first run,
compilation included, and the median milliseconds of later ones. The last column is the error of the means in exact standard
deviations (for the chaotic job the error from the truth). Processor time is that of all the process's threads; other work on
the machine disturbs it less than the clock's. Libraries need not agree on what they build on, so each has an environment of its
own; without a name, the libraries are listed. Names without a job are those of the drifting level; others end in the job.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import sys
import time
from importlib.metadata import version
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
LIBRARIES = sorted(file.stem for file in HERE.glob("with_*.py"))


def count_lines(path: Path) -> int:
    """Lines of a file, and of files beside it that it imports, without blanks, comments, docstring and future imports."""
    source = path.read_text(encoding="utf-8")
    docstring = ast.parse(source).body[0].end_lineno or 0
    rest = [line.strip() for line in source.splitlines()[docstring:]]
    imported = (path.with_name(f"{line.split()[1]}.py") for line in rest if line.startswith("import with_"))
    own = sum(bool(line) and not line.startswith(("#", "from __future__")) for line in rest)
    return own + sum(count_lines(each) for each in imported)


def main() -> None:
    """Run one library and print its row."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description="Jobs in several libraries.")
    parser.add_argument("library", nargs="?", help="one of " + ", ".join(name.removeprefix("with_") for name in LIBRARIES))
    parser.add_argument("--runs", type=int, default=20, help="timed runs after the first")
    given = parser.parse_args()
    if given.library is None:
        print(*(name.removeprefix("with_") for name in LIBRARIES), sep="\n")
        return
    sys.path[0] = str(HERE)
    module = importlib.import_module(f"with_{given.library}")
    job = importlib.import_module(getattr(module, "JOB", "job"))
    data = job.draw()
    mean, deviation = job.exact(data)
    began = time.process_time()
    run = module.prepare(data)
    run(0)
    first, seconds, errors = time.process_time() - began, [], []
    for seed in range(1, given.runs + 1):
        began = time.process_time()
        found = np.asarray(run(seed))
        seconds.append(time.process_time() - began)
        errors.append(np.sqrt(np.mean(((found - mean) / deviation) ** 2)))
    lines = count_lines(HERE / f"with_{given.library}.py")
    print(f"| {module.NAME} {version(module.PACKAGE)} | {module.METHOD} | {lines} | {first:.2f} | "
          f"{1e3 * np.median(seconds):.1f} | {np.mean(errors):.4f} |")  # fmt: skip


if __name__ == "__main__":
    main()
