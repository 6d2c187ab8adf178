"""Names that a spreadsheet would run are texts in the CSV files that are written, and names again where they are read."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from poseppl.cli.track_live import LiveTable
from poseppl.files.atomic_writing import write_rows
from poseppl.files.csv_fields import rows_of_csv, shielded, unshielded
from poseppl.motion.io.observations import Observations, read_observations, write_observations

FORMULAS = ['=HYPERLINK("http://x/")', "+1+1", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "'=1", "''@", "\uff1d1"]
PLAIN = ["hip_r", "'", "''", "it's", "'hip'", "a=b", "-1.5", "+3", "-inf", "1e5", ""]


def kept(name: str) -> str:
    return name.replace("\r", "\n")


@pytest.mark.parametrize("name", FORMULAS)
def test_formulas_are_texts(name: str) -> None:
    assert shielded(name) == f"'{kept(name)}" and unshielded(shielded(name)) == kept(name)


@pytest.mark.parametrize("name", PLAIN)
def test_other_texts_and_numbers_stay_as_they_are(name: str) -> None:
    assert shielded(name) == name and unshielded(name) == name and shielded(-2.5) == -2.5


def test_every_row_that_is_written_is_shielded(tmp_path: Path) -> None:
    write_rows(tmp_path / "rows.csv", [["name", "x"], *([name, -1.5] for name in FORMULAS)])
    with (tmp_path / "rows.csv").open(newline="", encoding="utf-8") as file:
        cells = [row[0] for row in csv.reader(file)]
    assert all(cell[0] not in "=+-@\t\r\uff1d" for cell in cells)
    assert [row[0] for _, row in rows_of_csv(tmp_path / "rows.csv")] == ["name", *map(kept, FORMULAS)]


def test_observations_of_such_names_come_back(tmp_path: Path) -> None:
    seen = Observations(np.ones((1, 1, len(FORMULAS), 2)), None, np.array([0]), tuple(FORMULAS), ("camera",))
    write_observations(tmp_path / "seen.csv", seen)
    assert "\n0,=" not in (tmp_path / "seen.csv").read_text("utf-8")
    np.testing.assert_array_equal(read_observations(tmp_path / "seen.csv", [*map(kept, FORMULAS)]).points, seen.points)


def test_a_live_table_quotes_its_names(tmp_path: Path) -> None:
    table = LiveTable(tmp_path / "live.csv", 60.0, print)
    table.begin(["=1", "left, upper"])
    table.close()
    (head,) = csv.reader([(tmp_path / "live.csv").read_text("utf-8")])
    assert head[3] == "'=1_x" and head[12] == "left, upper_x" and len(head) == 21
