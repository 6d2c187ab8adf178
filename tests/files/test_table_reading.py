"""Numbers of tables, and messages of what is none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.errors import InputError
from poseppl.files.table_reading import read_table

CELLS: dict[str, Callable[[str], str]] = {
    "table.csv": lambda word: f"x,y\n1,{word}\n",
    "head.csv": lambda word: f"{word},{word}\n1,2\n",
}


@pytest.mark.parametrize("name", CELLS)
def test_a_long_cell_of_a_table_makes_no_long_message(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(CELLS[name]("b" * 30_000))
    try:
        (error,) = read_table(path).unread.values()
    except InputError as raised:
        error = raised
    assert "bbb" in str(error) and len(str(error)) < len(str(path)) + 400


@pytest.mark.parametrize("word", ["1_000", "\uff11\uff12", "\u0663", "inf", "-Infinity", "1e999", "0x10", "1e", "1" * 65])
def test_numbers_of_tables_are_decimal_and_finite(tmp_path: Path, word: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"x,y\n1,2\n3,{word}\n", encoding="utf-8")
    table = read_table(path)
    assert list(table.columns) == ["x"] and "table.csv, line 3, y: " in str(table.unread["y"])


@pytest.mark.parametrize("word", ["noise=1_000", "noise=inf", "noise=\uff11", "noise", "noise="])
def test_numbers_of_options_are_decimal_and_finite(capsys: pytest.CaptureFixture[str], word: str) -> None:
    assert main(["run", "model.py", "--data", "data.csv", "--param", word]) == 2
    assert "expected NAME=NUMBER" in capsys.readouterr().err


def test_numbers_of_tables_have_no_other_bound(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("x\n+1.5e300\n-.5\n7.\nNaN\n1e-400\n")
    np.testing.assert_array_equal(read_table(path).columns["x"], [1.5e300, -0.5, 7, np.nan, 0])
