"""A folder of trials: each has its result, trials that fail are named, and only trials that have changed are done again."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from poseppl.cli import main, trial_jobs
from poseppl.motion.io import CameraRecord, write_cameras

CAMERA = CameraRecord("a", np.diag([900.0, 900.0, 1.0]), np.zeros(5), np.eye(3), np.array([0.0, 0.0, 3.0]), (1920, 1080))


def study(folder: Path) -> Path:
    """Three trials of two cameras; the last one has files of one camera alone."""
    for name, cameras in (("s1/walk", "ab"), ("s1/<hop>", "ab"), ("s2/run", "a")):
        (folder / name).mkdir(parents=True)
        for camera in cameras:
            (folder / name / f"{camera}.json").write_text("{}")
    write_cameras(folder / "calib.toml", [CAMERA, CAMERA._replace(name="b")])
    return folder


def test_a_dry_run_lists_trials_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["batch", "keypoints", str(study(tmp_path / "study")), "--dry-run", "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "s1/walk" in printed and "one camera alone" in printed and "calib.toml" in printed
    assert not (tmp_path / "out").exists()


def test_rows_of_all_trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Tracking is replaced by a row for each trial; the second call tracks the changed trial alone."""
    tracked: list[str] = []

    def tracking(job: trial_jobs.TrialJob, person: int) -> tuple[dict[str, Any], None, dict[str, str]]:
        tracked.append(job.trial)
        measures = {"cadence": ["1/min", 4, 110.0, 108.5, 111.5]}
        row = {"person": person, "frames": 50, "severity": "ok", "verdict": "sound", "notes": ["a note"]}
        return row | {"gait": "4 heel strikes", "measures": measures}, None, {}

    monkeypatch.setattr(trial_jobs, "people_of_keypoints", lambda source, most: 2)
    monkeypatch.setattr(trial_jobs, "_tracked", tracking)
    folder, out = study(tmp_path / "study"), tmp_path / "out"
    command = ["batch", "keypoints", str(folder), "--rate", "60", "--workers", "1", "-q", "-o", str(out)]
    assert main(command) == 1
    assert "1 of 3 trials failed: s2/run: one camera alone" in " ".join(capsys.readouterr().err.split())
    rows = {row["trial"]: row for row in csv.DictReader((out / "table.csv").read_text().splitlines())}
    assert sorted(tracked) == sorted(set(rows) - {"s2/run"}) == ["s1/<hop>", "s1/walk"]
    walk = rows["s1/walk"]
    assert [walk[f"cadence {end}(1/min)"] for end in ("", "lower ", "upper ")] == ["110", "108.5", "111.5"]
    assert (walk["frames"], walk["people seen"], rows["s2/run"]["severity"]) == ("50", "2", "failed")
    assert walk["notes"] == "a note | 2 people are seen by two cameras; --people 2 tracks all of them"
    page = (out / "page.html").read_text()
    assert "&lt;hop&gt;" in page and "<hop>" not in page and "110 (108" in page
    (folder / "s1/walk/b.json").write_text("{ }")
    assert main(command) == 1
    assert tracked[2:] == ["s1/walk"]
