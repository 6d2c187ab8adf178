"""Time of the tests: seconds of each file and test, and how many of them JAX traces, lowers and compiles.

    python tests/durations.py                            the default tests, with two processes and an empty compile cache
    python tests/durations.py --full -k kalman           other options are pytest's
    python tests/durations.py --csv durations.csv ...    also one row for each test

Measure on an idle machine. A test that compiles first pays for tests that use the same program later.
"""

from __future__ import annotations

import argparse
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

STEPS = ("jaxpr_trace_duration", "jaxpr_to_mlir_module_duration", "backend_compile_duration")
_PLUGIN = "durations-recorder"


class Duration(NamedTuple):
    """Seconds of a test: by the clock, of the process, and of JAX's steps (a program traced within another counts twice)."""

    test: str
    seconds: float
    processor: float
    tracing: float
    lowering: float
    compiling: float


class Recorder:
    """A pytest plugin that measures each test in the process that runs it, and gathers the durations in the first process."""

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
        if duration:
            self.durations.append(Duration(report.nodeid, *duration))


def pytest_configure(config: pytest.Config) -> None:
    """Measure in the processes of xdist, which load this file as a plugin, too."""
    if not config.pluginmanager.has_plugin(_PLUGIN):
        config.pluginmanager.register(Recorder(), _PLUGIN)


def table(durations: Iterable[Duration], most: int = 40) -> str:
    """The files and the tests that take longest."""
    by_file: dict[str, list[Duration]] = defaultdict(list)
    for duration in durations:
        by_file[duration.test.partition("::")[0]].append(duration)
    files = [_sum(name, rows) for name, rows in by_file.items()]
    tests = [duration for rows in by_file.values() for duration in rows]
    lines = ["".join(f"{name:>10}" for name in Duration._fields[1:])]
    for rows in (files, tests):
        longest = sorted(rows, key=lambda row: -row.seconds)[:most]
        shown = [*longest, _sum(f"{len(rows)} together\n", rows)]
        lines += ["".join(f"{seconds:10.1f}" for seconds in row[1:]) + f"  {row.test}" for row in shown]
    return "\n".join(lines)


def _sum(name: str, rows: list[Duration]) -> Duration:
    return Duration(name, *(sum(column) for column in zip(*(row[1:] for row in rows), strict=True)))


def main() -> int:
    """Run the command; pytest's exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--csv", type=Path, help="a file with one row for each test")
    given, arguments = parser.parse_known_args()
    recorder = Recorder()

    class Registered:
        @pytest.hookimpl(tryfirst=True)
        def pytest_configure(self, config: pytest.Config) -> None:
            config.pluginmanager.register(recorder, _PLUGIN)

    with tempfile.TemporaryDirectory(prefix="poseppl-empty-cache-") as cache:
        os.environ.setdefault("POSEPPL_COMPILE_CACHE", cache)
        os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, [str(Path(__file__).parent), os.environ.get("PYTHONPATH")]))
        status = pytest.main(["-n", "2", "-p", "durations", *arguments], plugins=[Registered()])
    if recorder.durations:
        print(table(recorder.durations))
    if given.csv:
        with given.csv.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([Duration._fields, *recorder.durations])
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
