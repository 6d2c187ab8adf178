"""Options and fixtures of all tests: --slow, the recordings, and a compile cache that outlives the run."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

CACHE = Path(os.environ.get("POSEPPL_COMPILE_CACHE", Path.home() / ".cache" / "poseppl" / "xla"))
DATA = Path(os.environ.get("POSEPPL_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))


def pytest_configure(config: pytest.Config) -> None:
    jax.config.update("jax_compilation_cache_dir", str(CACHE))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # thousands of small programs count, too


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long statistical checks too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--slow"):
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="a long check; run with --slow"))


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Drop the compiled programs of a file: each maps a piece of memory, and a process may have only some 65,000."""
    yield
    jax.clear_caches()
    gc.collect()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    if not DATA.is_dir():
        pytest.skip(f"no recordings in {DATA}; set POSEPPL_DATA to their folder")
    return DATA
