"""Console of a running command: progress and notes on stderr, tables on stdout."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from poseppl.cli.options import as_option, as_options
from poseppl.errors import MAX_SHOWN, cut
from poseppl.files.cache_folder import cache_folder, xla_folder
from poseppl.threads import spare_threads

_STYLES = {"error": "red", "warning": "yellow"}
_SECONDS_BETWEEN_LINES, _SECONDS_BETWEEN_LOOKS = 30.0, 1.0


def start_jax(devices: int = 1) -> None:
    """Let compiled programs outlive the process, in the user's cache folder; without one, they are compiled again.

    Args:
        devices: Make the CPU into so many devices, at most one for each core, unless the environment says how many it is.
    """
    import jax

    from poseppl.stored_programs import store_programs

    settings: Any = jax.config
    if devices > 1:
        cores = os.cpu_count() or 1
        spare_threads(devices)
        if "xla_force_host_platform_device_count" not in os.environ.get("XLA_FLAGS", ""):
            with suppress(RuntimeError):  # JAX has started already
                settings.update("jax_num_cpu_devices", min(devices, cores))
    if os.environ.get("JAX_COMPILATION_CACHE_DIR"):
        return
    folder = xla_folder()
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            settings.update("jax_compilation_cache_dir", str(folder))
            settings.update("jax_persistent_cache_min_compile_time_secs", 0.0)
            store_programs(cache_folder("programs"))


class ConsoleProgress:
    """A bar on stderr, or a line every half minute where that is no terminal; neither when asked to be quiet. Notes always.

    Lines appear during all work, including work that is not counted, such as compilation and smoothing. The remaining time is
    the elapsed time times the remaining work over the work done. Frames have equal costs, and those of the last half minute
    count. Jobs have their own costs, and all jobs of this call count.

    Args:
        quiet: Whether to show no bar.
        doing: Description of the work.
        unit: Unit of the count, frames or jobs.
    """

    def __init__(self, quiet: bool, doing: str = "tracking", unit: str = "frames") -> None:
        self._doing, self._unit = doing, unit
        self.console = Console(stderr=True, soft_wrap=True, highlight=False)
        self._bar = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.fields[count]}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=self.console,
            transient=True,
            disable=quiet or not self.console.is_terminal,
            speed_estimate_period=30.0 if unit == "frames" else math.inf,
        )
        self._task: Any = None
        self._done, self._total = 0, "?"
        self._lines = not quiet and not self.console.is_terminal
        self._told = self._bar.get_time()
        self._lock = Lock()

    @contextmanager
    def running(self) -> Iterator[ConsoleProgress]:
        """Show the bar inside of a block."""
        over = Event()
        clock = Thread(target=self._keep_telling, args=(over,), daemon=True)
        with self._bar:
            if self._lines:
                clock.start()
            try:
                yield self
            finally:
                over.set()
                if self._lines:
                    clock.join()

    def _keep_telling(self, over: Event) -> None:
        while not over.wait(_SECONDS_BETWEEN_LOOKS):
            self._tell()

    def stage(self, description: str, total: int | None = None) -> None:
        """Say what is being done now."""
        self._begin(description, total, 0, total)

    def advance(self, frames: int) -> None:
        """So many more frames are done."""
        self._step(frames, frames)

    def started(self, total: int, done: int, cost: float) -> None:
        """There are so many jobs, so many of them done before; the others cost so much."""
        self._begin(self._doing, total, done, cost)
        self._bar.advance(self._task, 0)  # from now on

    def finished(self, cost: float) -> None:
        """One more job is done or has failed; it cost so much."""
        self._step(1, cost)

    def _begin(self, description: str, total: int | None, done: int, work: float | None) -> None:
        self._done, self._total = done, "?" if total is None else str(total)
        if self._task is None:
            self._task = self._bar.add_task(description, total=work, count=self._count())
        else:
            (task,) = self._bar.tasks
            task.total = work  # an update without a total would leave that of the stage before
            self._bar.update(self._task, description=description, total=work, completed=0, count=self._count())

    def _step(self, number: int, work: float) -> None:
        self._done += number
        if self._task is not None:
            self._bar.update(self._task, description=self._doing, advance=work, count=self._count())
            self._tell()

    def _tell(self) -> None:
        """Write a line where there is no bar, and the last one is half a minute old."""
        with self._lock:
            now = self._bar.get_time()
            if not self._lines or not self._bar.tasks or now - self._told < _SECONDS_BETWEEN_LINES:
                return
            self._told = now
        (task,) = self._bar.tasks
        counted, remaining = task.total is not None, task.time_remaining
        count = f", {self._count()}" if counted else ""
        left = f", {timedelta(seconds=round(remaining))} left" if counted and remaining is not None else ""
        self.note(f"{task.description}{count}, {timedelta(seconds=round(task.elapsed or 0))}{left}")

    def _count(self) -> str:
        return f"{self._done}/{self._total} {self._unit}"

    def note(self, message: str) -> None:
        """Tell of something, above the bar."""
        self.console.print(f"poseppl: {cut(as_options(message), MAX_SHOWN)}", markup=False)


def print_table(title: str, rows: Sequence[Sequence[str]], head: Sequence[str] = ()) -> None:
    """Print a table on stdout: a first column of names, the others of what belongs to them, with a head if there is one."""
    table = Table(title=title, title_justify="left", show_header=bool(head))
    for index, name in enumerate(head or ("", "")):
        how: dict[str, Any] = {"justify": "right", "overflow": "fold"} if index else {"style": "bold", "no_wrap": True}
        table.add_column(name, **how)
    for row in rows:
        table.add_row(*row)
    Console(soft_wrap=False, highlight=False, markup=False).print(table)


def print_verdicts(results: Mapping[Path, Any], quiet: bool) -> None:
    """Print the worst verdict on each result, with its file's name where there are several.

    Args:
        results: The results by their files.
        quiet: Whether to write warnings and errors alone, on stderr.
    """
    for path, tree in results.items():
        print_verdict(tree, path, quiet, f"{path.name}: " if len(results) > 1 else "")


def print_verdict(tree: Any, path: Path, quiet: bool, about: str = "") -> None:
    """Print the worst verdict on a result, and how many warnings and errors there are besides.

    Args:
        tree: The result, with diagnostics.
        path: File of the result, for the command that writes a report.
        quiet: Whether to write warnings and errors alone, on stderr.
        about: Beginning of the line.
    """
    from poseppl.diagnostics import verdicts

    worst, *rest = verdicts(tree)
    others = sum(verdict.severity in _STYLES for verdict in rest)
    more = f" {others} more in the report: poseppl report {path}" if others else ""
    print_finding(worst.severity, f"{cut(worst.worded(as_option), MAX_SHOWN)}{more}", quiet, about)


def print_finding(severity: str, text: str, quiet: bool, about: str = "") -> None:
    """Print a finding, of a quiet command warnings and errors alone, on stderr.

    Args:
        severity: Its severity.
        text: The finding.
        quiet: Whether the command is quiet.
        about: The beginning of the line.
    """
    if severity in _STYLES or not quiet:
        console = Console(stderr=quiet, soft_wrap=True, highlight=False)
        start = "poseppl: " if quiet else ""
        console.print(f"{start}{about}{severity}: {text}", style=_STYLES.get(severity), markup=False)
