"""Interleaved timing: rivals run in turns, A B A B, so that whatever else the machine does falls on all of them alike."""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import jax
from jax.experimental.compilation_cache import compilation_cache
from poseppl_papers.tables import Kept, Provenance, Table, write_folder
from rich.console import Console
from rich.table import Table as ShownTable

from poseppl.jobs.job import versions

DATA = Path(os.environ.get("POSEPPL_DATA", "../shared/data"))
"""The folder of the recordings."""


class Timing(NamedTuple):
    """Seconds of the first call, which compiles, and the median of the others."""

    first: float
    median: float


def interleave(rivals: Mapping[str, Callable[[], Any]], repetitions: int) -> dict[str, Timing]:
    """Time functions of no argument in turns; what they return is waited for."""
    seconds: dict[str, list[float]] = {name: [] for name in rivals}
    for _ in range(repetitions + 1):
        for name, run in rivals.items():
            start = time.perf_counter()
            jax.block_until_ready(run())
            seconds[name].append(time.perf_counter() - start)
    return {name: Timing(values[0], statistics.median(values[1:])) for name, values in seconds.items()}


def show(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table."""
    table = ShownTable(*columns, title=title, title_justify="left")
    for row in rows:
        table.add_row(*row)
    Console(width=120).print(table)


def peak_memory() -> float:
    """Largest resident size of this process so far, in MiB."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would count what the parent held when it started this process
        return next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmHWM")) / 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


def write_table(table: Table, folder: Path, runs: str, recordings: str, note: str = "") -> None:
    """Write a table in the form of studies/tables, with the command that ran, today's date and the versions."""
    known = ", ".join(f"{name} {version}" for name, version in versions().items())
    command = f"python -m {Path(sys.argv[0]).parent.name}.{Path(sys.argv[0]).stem}"
    made = Provenance(runs, recordings, datetime.now(UTC).date().isoformat(), known, command, note)
    write_folder(folder, {table.name: Kept(table, made)})


def without_compile_cache() -> None:
    """Compile all from here on; JAX asks its settings at the first program alone, which imports may have compiled."""
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()


def arguments(description: str | None, **options: Any) -> argparse.Namespace:
    """Parse --quick, flags (False by default), and options of the type of their defaults; the folder ``output`` is made."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--quick", action="store_true", help="a tiny size, to see that it runs")
    for name, default in options.items():
        option = f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(option, action="store_true")
        else:
            parser.add_argument(option, type=type(default), default=default, help=f"{default} by default")
    given = parser.parse_args()
    if "output" in options:
        given.output = Path(given.output)
        given.output.mkdir(parents=True, exist_ok=True)
    return given
