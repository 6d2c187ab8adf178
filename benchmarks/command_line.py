"""How long a person waits for the command line: with an empty compile cache, and with what an earlier run left in it.

    python -m benchmarks.command_line [--quick] [--turns 5] [--output command-line]

Each command runs in a new process, first with an empty cache folder and then twice with what the first left. The second run is
not counted: files that the system had to read from the disk are in memory then. Clock and processor seconds are medians over
turns. Recordings are those of $POSEPPL_DATA; without it only the built-in walk is tracked. --quick is one turn of the help and
of the built-in walk.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from poseppl_papers.tables import Table

from benchmarks.timing import DATA, arguments, show, write_table

NAME = "command_line"
_COLUMNS = ("command", "empty_clock", "empty_processor", "full_clock", "full_processor")
_ABOUT = (
    "Seconds of a command of poseppl in a new process, by the clock and of the processor, with an empty cache and a full one."
)
_BEAM = DATA / "pose2sim_balancing"


def commands(quick: bool) -> dict[str, list[str]]:
    """Commands by what they do."""
    found = {"help": ["--help"], "built-in walk, 60 frames": ["track", "--quiet"]}
    if quick or not _BEAM.is_dir():
        return found
    shared = ["--calibration", f"{_BEAM}/calibration/Calib_qualisys.toml", "--rate", "60", "--frames", "0:60", "--quiet"]
    for cameras in ((1, 2, 3, 4), (1,)):
        files = [f"cam_0{camera}={_BEAM}/pose/cam0{camera}_json" for camera in cameras]
        found[f"keypoints, {len(cameras)} cameras, 60 frames"] = ["track", "keypoints", *files, *shared]
    return found


def seconds_of(words: list[str], cache: Path, folder: str) -> tuple[float, float]:
    """Seconds of a command by the clock and of the processor.

    Raises:
        RuntimeError: It failed.
    """
    environment = {name: value for name, value in os.environ.items() if name != "JAX_COMPILATION_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(cache)}
    command, started = [sys.executable, "-m", "poseppl.cli", *words], time.perf_counter()
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"poseppl {' '.join(words)} ended with {process.returncode}")
    return time.perf_counter() - started, usage.ru_utime + usage.ru_stime


def measure(words: list[str]) -> list[float]:
    """Clock and processor seconds with an empty cache, and with a full one."""
    with TemporaryDirectory() as folder, TemporaryDirectory() as cache:
        empty, _, full = (seconds_of(words, Path(cache), folder) for _ in range(3))
    return [*empty, *full]


def main() -> None:
    options = arguments(__doc__, turns=5, output="command-line")
    cases = commands(options.quick)
    turns = [{name: measure(words) for name, words in cases.items()} for _ in range(1 if options.quick else options.turns)]
    measured = [(name, *map(statistics.median, zip(*(turn[name] for turn in turns), strict=True))) for name in cases]
    write_table(Table(NAME, _COLUMNS, measured, _ABOUT), options.output, str(len(turns)), "none", "medians of runs in turns")
    rows = [[row[0], *(f"{seconds:.2f}" for seconds in row[1:])] for row in measured]
    heads = [name.replace("_", ", ") for name in _COLUMNS]
    show("Seconds of a command, cache empty or full", heads, rows)


if __name__ == "__main__":
    main()
