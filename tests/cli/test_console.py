"""Output of a command while it runs, and when it is interrupted."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from waiting import PATIENCE, wait_until

from poseppl.cli import _told, cli, console, main
from poseppl.cli.console import ConsoleProgress
from poseppl.files.atomic_writing import atomic_path, write_atomically

pytestmark = pytest.mark.usefixtures("here")


def test_lines_come_while_nothing_is_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """A smoother, or a compilation, reports no progress."""
    monkeypatch.setattr(console, "_SECONDS_BETWEEN_LOOKS", 0.001)
    bar, now, notes = ConsoleProgress(False), [0.0], list[str]()
    bar._told, bar._bar.get_time = 0.0, lambda: now[0]
    monkeypatch.setattr(bar, "note", notes.append)
    with bar.running():
        bar.stage("compiling", total=5)
        now[0] = 31.0
        wait_until(lambda: notes)
        bar.advance(5)
        bar.stage("smoothing 5 frames")
        now[0] = 62.0
        wait_until(lambda: len(notes) > 1)
    assert notes == ["compiling, 0/5 frames, 0:00:31", "smoothing 5 frames, 0:01:02"]
    now[0] = 93.0
    assert capsys.readouterr().err == "" and len(notes) == 2


@pytest.mark.parametrize("names", [["a.nc", "a.png"], []])
def test_an_interrupted_command_names_what_it_has_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], names: list[str]
) -> None:
    @click.command()
    def write() -> None:
        for name in names:
            write_atomically(name, "all of it")
        with atomic_path("b.nc") as path:
            path.write_text("half of")
            raise KeyboardInterrupt

    monkeypatch.setitem(cli.commands, "write", write)
    assert main(["write"]) == 130
    expected = f"written, each whole: {', '.join(names)}" if names else "no file was written"
    assert capsys.readouterr().err.strip() == f"poseppl: interrupted; {expected}"
    assert sorted(path.name for path in Path().iterdir()) == names


def test_many_files_of_a_folder_are_counted() -> None:
    files = [Path("a.nc"), *(Path("jobs") / f"{number}.npz" for number in range(7))]
    assert _told(files) == "written, each whole: a.nc, 7 files in jobs"


LEVELS = """
import os, sys
import poseppl
from poseppl.cli import main
print(os.environ.get("TF_CPP_MIN_LOG_LEVEL"))
main(["doctor", "--no-jax"])
print(os.environ.get("TF_CPP_MIN_LOG_LEVEL"))
"""
SLOW_TO_COMPILE = """
from poseppl.cli import main
main(["filters", "hmc"])
import jax, jax.numpy as jnp
sums = lambda: jax.lax.reduce_window(jnp.ones((130, 130)), 0.0, jax.lax.add, (32, 32), (1, 1), "SAME").sum()
jax.jit(sums).lower().compile()
"""


def run(code: str, level: str | None) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "TF_CPP_MIN_LOG_LEVEL"}
    environment |= {} if level is None else {"TF_CPP_MIN_LOG_LEVEL": level}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE, env=environment)


@pytest.mark.parametrize(("given", "levels"), [(None, ("None", "3")), ("1", ("1", "1"))])
def test_commands_silence_xla_and_the_library_does_not(given: str | None, levels: tuple[str, str]) -> None:
    lines = run(LEVELS, given).stdout.splitlines()
    assert (lines[0], lines[-1]) == levels


@pytest.mark.slow
def test_no_alarm_of_a_long_compilation_reaches_the_user() -> None:
    """With the level that JAX sets, it does."""
    assert "slow_operation_alarm" in run(SLOW_TO_COMPILE, "1").stderr
    assert run(SLOW_TO_COMPILE, None).stderr == ""
