"""Options and fixtures of all tests: their tiers, the recordings, and a compile cache that outlives the run.

A test without a mark is of the default tier. Tests that compile a large program or start several processes are marked `full`,
and long statistical checks `slow`. `--full` runs the first two tiers, `--slow` all three. `python tests/durations.py` prints
the time of each test.
"""

from __future__ import annotations

import gc
import os
import signal
import warnings
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import jax
import pytest

CACHE = Path(os.environ.get("POSEPPL_COMPILE_CACHE", Path.home() / ".cache" / "poseppl" / "xla"))
MAX_MAPS = 20_000
DATA = Path(os.environ.get("POSEPPL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("markexpr") != "slow":  # slow tests compute more than they compile
        compile_quickly()
    jax.config.update("jax_compilation_cache_dir", str(CACHE))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # thousands of small programs count, too
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # a shell starts what runs in the background so, and the programs that tests interrupt would inherit it
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if config.getoption("numprocesses", None):
        # ArviZ 0.23 notes the day in a file at its first import, where two workers fail one another
        with warnings.catch_warnings(action="ignore"):
            import arviz  # noqa: F401


def compile_quickly() -> None:
    """Compile at XLA's lowest level: short programs run as fast, and compile in half of the time (tests/durations.py)."""
    jax.config.update("jax_disable_most_optimizations", True)
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"  # of programs that tests start
    flag = "--xla_cpu_use_fusion_emitters=false"  # XLA aborts at flags that it does not know, as those of later releases may
    if jax.__version_info__ < (0, 11) and flag not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}".strip()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--full", action="store_true", help="also run what compiles large programs or starts several processes")
    parser.addoption("--slow", action="store_true", help="run all: also the long statistical checks")
    parser.addoption("--part", type=_part, metavar="K/N", help="run every N-th of the files that have tests, from the K-th on")
    parser.addoption("--no-skips", action="store_true", help="a test that skips itself fails: this machine should have it all")


def _part(text: str) -> tuple[int, int]:
    part, number = map(int, text.split("/"))
    if not 1 <= part <= number:
        raise ValueError(text)
    return part, number


@pytest.hookimpl(trylast=True)  # after -m and -k have chosen
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    left_out = {"slow"} if config.getoption("--full") else {"full", "slow"}
    if config.getoption("--slow"):
        left_out = set()
    chosen = [item for item in items if not any(item.get_closest_marker(tier) for tier in left_out)]
    if config.getoption("--part"):
        part, number = config.getoption("--part")
        files = set(sorted({item.path for item in chosen})[part - 1 :: number])
        chosen = [item for item in chosen if item.path in files]
    kept = set(chosen)
    config.hook.pytest_deselected(items=[item for item in items if item not in kept])
    items[:] = chosen


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Count the skipped tests in one line, with the reasons."""
    reasons = Counter(str(report.longrepr[2]).removeprefix("Skipped: ") for report in terminalreporter.stats.get("skipped", []))
    if reasons:
        listed = "; ".join(f"{number} because {reason}" for reason, number in reasons.most_common())
        terminalreporter.write_line(f"{reasons.total()} skipped: {listed}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    return _unskipped(item.config, (yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, Any, Any]:
    return _unskipped(collector.config, (yield))


def _unskipped(config: pytest.Config, report: Any) -> Any:
    """The report of a test; with --no-skips a skip is a failure."""
    if report.skipped and config.getoption("--no-skips") and not hasattr(report, "wasxfail"):
        report.outcome, report.longrepr = "failed", f"skipped, with --no-skips: {report.longrepr}"
    return report


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Drop compiled programs before they are too many: each maps pieces of memory, and a process may have only some 65,000."""
    yield
    maps = Path("/proc/self/maps")
    if not maps.exists() or maps.read_bytes().count(b"\n") > MAX_MAPS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def optimised() -> Iterator[None]:
    """Compile as users do: for tests of how programs are compiled, or whose answer depends on how numbers are rounded."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands write into a folder of the test's own; programs that they start share the compile cache."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(jax.config.jax_compilation_cache_dir))


@pytest.fixture(scope="session")
def data_dir() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"no recordings in {DATA}; set POSEPPL_DATA to their folder")
    return DATA
