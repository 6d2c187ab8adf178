"""Outputs that remain when a run, its disk or its picture fails, or somebody ends it."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from breaking_filter import break_down

import poseppl.cli.outputs
import poseppl.files.atomic_writing
from poseppl.cli import main
from poseppl.cli.outputs import write_outputs
from poseppl.errors import PosepplError
from poseppl.motion.tracking import problem_of_result
from poseppl.runs.results import load_result, provenance

SMALL = ["--filter", "kalman", "--set", "num_particles=20", "--frames", "0:4", "-q"]


@pytest.fixture(autouse=True)
def _below(here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Any:
    target = tmp_path_factory.mktemp("run") / "run.nc"
    assert main(["track", *SMALL, "-o", str(target)]) == 0
    return load_result(target)


@pytest.fixture
def full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Folders whose disk is full; the other folders that a result may go to are a spare one and a home."""
    folders = [tmp_path / "here"]
    flush = poseppl.files.atomic_writing._flush

    def flush_or_fail(path: Path) -> None:
        if any(folder in path.resolve().parents for folder in folders):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        flush(path)

    for name in ("spare", "home"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "spare"))
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(poseppl.cli.outputs, "_SHARED_MEMORY", tmp_path / "none")
    monkeypatch.setattr(poseppl.files.atomic_writing, "_flush", flush_or_fail)
    return folders


@pytest.mark.slow
def test_a_result_without_room_goes_elsewhere(tmp_path: Path, full: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *SMALL]) == 1
    message = capsys.readouterr().err
    (kept,) = (tmp_path / "spare").glob("poseppl-*/poseppl-walk.nc")
    assert "the disk is full" in message and f"kept in {kept}" in message and len(message.splitlines()) == 1
    assert load_result(kept)["posterior"].sizes["frame"] == 4 and not any(Path().iterdir())


@pytest.mark.slow
def test_every_folder_is_tried(tmp_path: Path, full: list[Path], tree: Any) -> None:
    full.append(tmp_path / "spare")
    with pytest.raises(PosepplError, match=f"kept in {tmp_path}/home/poseppl-"):
        write_outputs(tree, Path("a.nc"), print)
    full.append(tmp_path / "home")
    with pytest.raises(PosepplError, match=r"disk is full.*nor was there room.*free some space.*--checkpoint"):
        write_outputs(tree, Path("a.nc"), print)
    assert not any(Path().iterdir()) and not any((tmp_path / "spare").iterdir())


@pytest.mark.full
def test_a_picture_that_fails_costs_nothing(tree: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: Any) -> None:
        raise RuntimeError("no such colour")

    notes: list[str] = []
    monkeypatch.setattr("poseppl.report.plot_track", broken)
    assert write_outputs(tree, Path("a.nc"), notes.append) == [("result", Path("a.nc"))]
    assert load_result("a.nc")["posterior"].equals(tree["posterior"])
    assert len(notes) == 1 and "a.png: not drawn, but the result is written: no such colour" in notes[0]


@pytest.mark.full
@pytest.mark.parametrize("view", ["nan", "inf", "361"])
def test_no_camera_stands_at_an_angle_that_is_none(view: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["track", *SMALL, "--view", view]) == 1
    assert "--view" in capsys.readouterr().err


@pytest.mark.slow
def test_names_that_are_no_text(capsys: pytest.CaptureFixture[str]) -> None:
    """Names of files are bytes; those of other times and systems are not UTF-8."""
    assert main(["simulate", "--frames", "0:4", "-q", "-o", "plain.csv"]) == 0
    points, result = os.fsdecode(b"w\xff.csv"), os.fsdecode(b"poseppl-w\xff.nc")
    shutil.copy("plain.csv", points)
    assert main(["track", "--observations", points, "--camera", "plain.toml", *SMALL[:-3]]) == 0
    assert "poseppl-w\\udcff.nc" in capsys.readouterr().out.replace("\n", "")
    assert provenance(load_result(result))["input"] == "w?.csv"
    assert Path(result).with_suffix(".png").exists()
    shutil.copy(result, os.fsdecode(b"again\xff.nc"))
    assert main(["report", result]) == 0
    assert main(["compare", result, os.fsdecode(b"again\xff.nc"), "-q"]) == 0
    assert "w?.csv" in Path(result).with_suffix(".html").read_text(encoding="utf-8")


@pytest.mark.full
def test_frames_before_one_that_breaks_down_are_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at = 1
    break_down(monkeypatch, at)
    assert main(["track", *SMALL, "--filter", "breaking"]) == 1
    message = capsys.readouterr().err
    assert f"frame {at}: the filter's state is not finite" in message
    assert f"; the frames before it, {at} of 4, are in poseppl-walk.nc" in message
    tree = load_result("poseppl-walk.nc")
    assert tree["posterior"].sizes["frame"] == at and "not finite" in provenance(tree)["stopped"]
    assert np.isfinite(tree["unconstrained_posterior/state"]).all() and tree["truth/markers"].shape[0] == at
    assert len(problem_of_result(tree).observations.values["points"]) == at
    assert main(["report", "poseppl-walk.nc", "-q"]) == 0 and Path("poseppl-walk.png").exists()
