"""`poseppl doctor` tells what is missing, and how to get it."""

from __future__ import annotations

from pathlib import Path

import pytest

from poseppl.cli import main
from poseppl.cli.doctor import missing_extras, requirements

DECLARED = [
    "numpy>=2.0",
    'nowhere-to-be-found[all]>=1.5; extra == "mocap"',
    "numpy>=2.0 ; extra == 'mocap'",
    'poseppl[mocap]; extra == "render"',
    'ruff>=0.9; extra == "dev"',
]


def test_requirements_are_read_with_what_is_installed() -> None:
    first, second, *_ = requirements(DECLARED)
    assert (first.name, first.bound, first.extra) == ("numpy", ">=2.0", "") and first.installed
    assert (second.name, second.bound, second.extra, second.installed) == ("nowhere-to-be-found", ">=1.5", "mocap", None)


def test_extras_name_what_they_lack_and_those_of_developers_are_left_out() -> None:
    assert missing_extras(requirements(DECLARED)) == {"mocap": ["nowhere-to-be-found"]}


def test_a_missing_extra_comes_with_its_command(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("poseppl.cli.doctor.requires", lambda name: DECLARED)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["doctor", "--no-jax"]) == 0
    printed = capsys.readouterr().out
    assert "lacks nowhere-to-be-found: pip install 'poseppl[mocap]'" in printed and "ruff" not in printed


def test_a_missing_need_is_a_failure(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("poseppl.cli.doctor.requires", lambda name: ["nowhere-to-be-found>=1"])
    assert main(["doctor", "--no-jax"]) == 1
    assert "MISSING" in capsys.readouterr().out


def test_devices_and_folders_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "program").write_bytes(bytes(3 * 2**20))
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("POSEPPL_DATA", str(tmp_path / "absent"))
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["doctor"]) == 0
    printed = capsys.readouterr().out
    assert f"{tmp_path}: 1 files, 3 MiB" in printed and "absent: not there yet" in printed and "cpu:0" in printed
