"""The command `poseppl compare`: files, names, refusals."""

from __future__ import annotations

import hashlib
import re
import shutil
from pathlib import Path

import pytest
from same_data import run_on, scene

from poseppl.cli import main
from poseppl.runs.results import save_result

DATA = scene(num_frames=8)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    (folder / "folder").mkdir()
    save_result(run_on(DATA), folder / "slow.nc")
    save_result(run_on(DATA, seed=1, seconds=0.01), folder / "quick.nc")
    save_result(run_on(DATA, seed=2), folder / "folder/quick.nc")
    save_result(run_on(scene(num_frames=5)), folder / "other.nc")
    (folder / "text.nc").write_text("no result")
    return folder


@pytest.fixture(autouse=True)
def _here(results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(results, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")  # headings on one line


def test_page_and_table_are_written_and_results_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    inputs = {path: hashlib.sha256(path.read_bytes()).digest() for path in Path().glob("*.nc")}
    assert main(["compare", "slow.nc", "quick.nc", "again=folder/quick.nc", "--csv", "table.csv"]) == 0
    printed = capsys.readouterr().out
    for word in (
        "quick",
        "again",
        "ESS",
        "comparison.html",
        "table.csv",
        "quick has the highest ESS per second",
    ):
        assert word in printed
    assert Path("comparison.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert len(Path("table.csv").read_text(encoding="utf-8").splitlines()) == 1 + 3 * 8 * 3
    assert {path: hashlib.sha256(path.read_bytes()).digest() for path in inputs} == inputs
    assert main(["compare", "slow.nc", "quick.nc", "-q", "-o", "folder/page.html"]) == 0
    assert capsys.readouterr().out == ""
    assert Path("folder/page.html").is_file()


def test_the_table_has_seconds_and_no_empty_column(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A result of 8 frames: 0.01 s each by the clock; one run has processor seconds, none has the evidence."""
    monkeypatch.setenv("COLUMNS", "80")
    tree = run_on(DATA, seed=1, seconds=0.01)
    tree.attrs["cpu_seconds"] = "0.128"
    save_result(tree, "quick.nc")
    assert main(["compare", "slow.nc", "quick.nc"]) == 0
    lines = capsys.readouterr().out.splitlines()
    cells = [[cell.strip() for cell in re.split("[│┃]", line)[1:-1]] for line in lines if line[:1] in ("│", "┃")]
    head = [" ".join(filter(None, part)) for part in zip(*cells[:-2], strict=True)]
    assert head[:3] == ["run", "wall (s)", "CPU (s)"] and "error (mm)" in head
    assert [row[0] for row in cells[-2:]] == ["slow", "quick"]
    assert cells[-1][1:3] == ["0.08", "0.13"] and cells[-2][2] == "–"
    assert all(any(row[k] != "–" for row in cells[-2:]) for k in range(len(head)))
    words = set(re.findall("[a-z]{4,}", " ".join(head)))
    assert words <= {"wall", "mean", "eval", "error", "coverage"}, "no word is broken"


@pytest.mark.full
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["slow.nc", "absent.nc"], ["absent.nc", "no such file"]),
        (["slow.nc", "text.nc"], ["text.nc", "not an HDF5 or NetCDF file"]),
        (["slow.nc", "other.nc"], ["other.nc: a run of other data: frames 0-4, but frames 0-7 in slow.nc"]),
        (["quick.nc", "folder/quick.nc"], ["a second run called 'quick'", "NAME=folder/quick.nc"]),
        (["slow.nc", "slow.nc"], ["a second run called 'slow'"]),
        (["tie=slow.nc", "quick.nc"], ["called 'tie'"]),
        (["slow.nc", "quick.nc", "-o", "slow.nc"], ["slow.nc", "NAME.html"]),
        (["slow.nc", "quick.nc", "--csv", "slow.nc"], ["slow.nc", "NAME.csv"]),
        (["slow.nc", "quick.nc", "-o", "nowhere/page.html"], ["nowhere", "does not exist"]),
        (["slow.nc", "quick.nc", "--csv", "nowhere/table.csv"], ["nowhere", "does not exist"]),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    before = sorted(Path().rglob("*"))
    assert main(["compare", *arguments]) == 1
    message = capsys.readouterr().err
    assert message.startswith("poseppl: ") and len(message.strip().splitlines()) == 1
    for word in words:
        assert word in message
    assert sorted(Path().rglob("*")) == before


@pytest.mark.full
@pytest.mark.parametrize("arguments", [[], ["slow.nc"], ["slow.nc", "quick.nc", "--unknown"]])
def test_wrong_usage(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert main(["compare", *arguments]) == 2
    assert "Usage: poseppl compare" in capsys.readouterr().err


@pytest.mark.full
def test_a_failure_leaves_older_outputs_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("comparison.html").write_text("older page")
    Path("table.csv").write_text("older table")

    def full(*arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("poseppl.report.compare.comparison_table", full)
    assert main(["compare", "slow.nc", "quick.nc", "--csv", "table.csv"]) == 1
    assert Path("comparison.html").read_text() == "older page" and Path("table.csv").read_text() == "older table"
    assert not list(Path().glob(".*"))
