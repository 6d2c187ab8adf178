"""The options of tests/conftest.py, and tests that are started in the background."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.full

SAMPLES = """
import signal
import pytest

def test_interrupts():
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

def test_without_data():
    pytest.skip("no data")

@pytest.mark.full
def test_large():
    pass

@pytest.mark.slow
def test_long():
    assert False
"""
OTHERS = """
import pytest

@pytest.mark.full
@pytest.mark.slow
def test_longer():
    pass
"""
ALWAYS, LARGE, SLOW = (
    ("PASSED", "test_interrupts"),
    ("PASSED", "test_large"),
    {("FAILED", "test_long"), ("PASSED", "test_longer")},
)


@pytest.fixture
def outcomes(tmp_path):
    """Names of the samples that pass and fail under some options, all started as a shell starts what runs in the background."""
    shutil.copy(Path(__file__).parent / "conftest.py", tmp_path)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  full\n  slow\n")
    (tmp_path / "test_first.py").write_text(SAMPLES)
    (tmp_path / "test_second.py").write_text(OTHERS)

    def run(*options):
        command = [sys.executable, "-m", "pytest", "-rA", "-p", "no:cacheprovider", *options]
        environment = {**os.environ, "PYTEST_ADDOPTS": ""}
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        finally:
            signal.signal(signal.SIGINT, before)
        words = [line.split() for line in done.stdout.splitlines() if line.startswith(("PASSED", "FAILED", "SKIPPED"))]
        return {(word, name.partition("::")[2]) for word, name, *_ in words} - {("SKIPPED", "")}

    return run


def test_tiers_are_left_out_and_skips_are_allowed_unless_asked(outcomes):
    assert outcomes() == {ALWAYS}
    assert outcomes("--full") == {ALWAYS, LARGE}
    assert outcomes("--no-skips") == {ALWAYS, ("FAILED", "test_without_data")}


def test_parts_of_files_make_up_the_whole(outcomes):
    first, second = (outcomes("--slow", "--part", f"{part}/2") for part in (1, 2))
    assert first | second == {ALWAYS, LARGE} | SLOW and not first & second
    assert second == {("PASSED", "test_longer")}
    assert outcomes("--slow", "-m", "slow", "--part", "1/1") == SLOW
