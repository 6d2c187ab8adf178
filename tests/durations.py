"""Where the time of the tests goes: seconds of each file and test, and how many of them trace, lower and compile.

    python tests/durations.py                            the default tests, with two processes and an empty compile cache
    python tests/durations.py --full -k kalman           what follows is pytest's
    python tests/durations.py --csv durations.csv ...    one row for each test, too

Measure on an idle machine. A test that compiles first pays for tests that use the same program later.
"""

from __future__ import annotations

import csv
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import pytest

ROOT = Path(__file__).resolve().parents[1]
STEPS = ("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration", "backend_compile_duration")


class Duration(NamedTuple):
    """Seconds of a test: by the clock, of the process, and of JAX's steps (a program traced within another counts twice)."""

    test: str
    seconds: float
    processor: float
    tracing: float
    lowering: float
    compiling: float


class Recorder:
    """A pytest plugin that measures each test where it runs, and gathers the durations in the process that began."""

    def __init__(self) -> None:
        self.durations: list[Duration] = []
        self._steps = dict.fromkeys(STEPS, 0.0)
        jax.monitoring.register_event_duration_secs_listener(self._add)

    def _add(self, event: str, seconds: float, **_: object) -> None:
        step = event.rpartition("/")[2]
        if step in self._steps:
            self._steps[step] += seconds

    def _now(self) -> tuple[float, ...]:
        return time.perf_counter(), time.process_time(), *self._steps.values()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        item.user_properties.append(("before", self._now()))
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
        report = yield
        if call.when == "teardown":
            before = dict(item.user_properties)["before"]
            seconds = [end - start for start, end in zip(before, self._now(), strict=True)]
            report.user_properties.append(("duration", seconds))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        duration = dict(report.user_properties).get("duration")
        if duration and not hasattr(report, "workerinput") and "PYTEST_XDIST_WORKER" not in os.environ:
            self.durations.append(Duration(report.nodeid, *duration))


def pytest_configure(config: pytest.Config) -> None:
    """Measure in xdist's workers, too: they load this module as a plugin of theirs."""
    if not config.pluginmanager.has_plugin("durations-recorder"):
        config.pluginmanager.register(Recorder(), "durations-recorder")


def table(durations: Iterable[Duration], most: int = 40) -> str:
    """The files that take longest, and the tests."""
    by_file: dict[str, list[Duration]] = defaultdict(list)
    for duration in durations:
        by_file[duration.test.partition("::")[0]].append(duration)
    files = [Duration(name, *map(sum, zip(*(row[1:] for row in rows), strict=True))) for name, rows in by_file.items()]
    tests = [duration for rows in by_file.values() for duration in rows]
    lines = ["".join(f"{name:>10}" for name in Duration._fields[1:])]
    for rows in (files, tests):
        total = Duration(f"{len(rows)} together\n", *map(sum, zip(*(row[1:] for row in rows), strict=True)))
        longest = sorted(rows, key=lambda row: -row.seconds)[:most]
        lines += ["".join(f"{seconds:10.1f}" for seconds in row[1:]) + f"  {row.test}" for row in [*longest, total]]
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Run the command; pytest's exit status."""
    target = None
    if "--csv" in arguments:
        where = arguments.index("--csv")
        target = arguments[where + 1]
        arguments = arguments[:where] + arguments[where + 2 :]
    recorder = Recorder()
    with tempfile.TemporaryDirectory(prefix="poseppl-empty-cache-") as cache:
        os.environ.setdefault("POSEPPL_COMPILE_CACHE", cache)
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(ROOT / "tests"), os.environ.get("PYTHONPATH")]))
        status = pytest.main(["-n", "2", "-p", "durations", *arguments], plugins=[_Named(recorder)])
    print(table(recorder.durations))
    if target:
        with open(target, "w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([Duration._fields, *recorder.durations])
    return int(status)


class _Named:
    """Registers a recorder under the name that `pytest_configure` looks for."""

    def __init__(self, recorder: Recorder) -> None:
        self.recorder = recorder

    @pytest.hookimpl(tryfirst=True)
    def pytest_configure(self, config: pytest.Config) -> None:
        config.pluginmanager.register(self.recorder, "durations-recorder")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
