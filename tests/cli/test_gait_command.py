"""`poseppl gait`: a page and three tables."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from drawn_bodies import drawn_result
from poseppl_models.bodies.gait import walk

from poseppl.cli import main
from poseppl.motion.report.pages import ShownCycle, ShownMeasure, gait_html
from poseppl.runs.results import save_result

ENDS = ("", "_events", "_cycles")


def test_the_page_says_what_it_shows() -> None:
    measures = [
        ShownMeasure("stride length", "left", "m", 2, 1.3, 1.28, 1.32, 0.01),
        ShownMeasure("stride length", "right", "m", 1, 1.2, 1.18, 1.22, float("nan")),
        ShownMeasure("cadence", "both", "steps/min", 3, 110.0, 108.0, 112.0, 1.0),
    ]
    lines = np.stack([np.linspace(0, 10, 101) + shift for shift in (-1, 0, 1)])
    cycles = [ShownCycle("knee angle", "left", lines, 62.0), ShownCycle("knee angle", "right", lines, None)]
    events = [{"kind": "heel strike", "side": "left", "mean": 0.5, "lower": 0.49, "upper": 0.51}]
    page = gait_html("Gait of <walk>", measures, cycles, events, ["It is a note."], 0.9)
    for text in (
        "Gait of &lt;walk&gt;",
        "1.30 ± 0.01 (1.28 to 1.32)",
        "1.20 (1.18 to 1.22)",
        "2 / 1",
        "It is a note.",
        "90 % interval",
    ):
        assert text in page
    assert "knee angle" in page and "heel strike" in page


@pytest.mark.full
def test_files_beside_the_result(here: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    states, _ = walk(30.0, 90)
    tree = drawn_result(states, np.full(states.shape[1], 1e-3), np.arange(90), 30.0, num_draws=5)
    save_result(tree, tmp_path / "walk.nc")
    assert main(["gait", "walk.nc"]) == 1
    assert "not of whole trajectories" in capsys.readouterr().err
    tree.attrs["joint"] = "true"
    save_result(tree, tmp_path / "walk.nc")
    assert main(["gait", "walk.nc", "--level", "0.9"]) == 0
    assert capsys.readouterr().out.split() == [f"walk_gait{end}" for end in (".html", ".csv", "_events.csv", "_cycles.csv")]
    rows, events, cycles = (list(csv.DictReader(Path(f"walk_gait{end}.csv").read_text().split("\n"))) for end in ENDS)
    assert all(float(row["lower"]) <= float(row["mean"]) <= float(row["upper"]) for row in rows)
    assert {"stride time", "cadence", "walking speed"} <= {row["figure"] for row in rows}
    assert [row["event"] for row in events].count("heel strike") >= 3
    assert len(cycles) % 101 == 0 and "knee_angle_r" in {row["angle"] for row in cycles}
