"""The page's statements about other libraries for motion: the smallest errors, counted again from the table."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from poseppl_papers.tables import Table

from studies.verdicts import motion_peers
from studies.verdicts.pages import DOCS, read_tables

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.quick
TABLE = read_tables()["motion_peers"]


def smallest(table: Table) -> int:
    """In how many of the errors that are compared poseppl's default is below all other libraries."""
    number = 0
    for cameras in ("1-4", "2-4", "1-2-4"):
        rows = table.records(cameras=cameras)
        for name in motion_peers.MEASURES:
            ours = [row[name] for row in rows if row["library"].startswith("poseppl") and row["method"] in motion_peers.DEFAULT]
            number += ours[0] < min(row[name] for row in rows if not row["library"].startswith("poseppl"))
    return number


def test_the_page_counts_the_smallest_errors():
    told = re.search(
        r"poseppl has the lowest error in (\d+) of these", (DOCS / "validation" / "libraries.md").read_text(encoding="utf-8")
    )
    assert told and int(told[1]) == smallest(TABLE)


@pytest.mark.full
@pytest.mark.parametrize(("factor", "number"), [(0.1, 12), (10.0, 0)])
def test_smaller_and_larger_errors_would_be_reported(factor, number):
    places = [TABLE.columns.index(name) for name in motion_peers.MEASURES]
    rows = [
        tuple(factor * value if index in places and row[1].startswith("poseppl") else value for index, value in enumerate(row))
        for row in TABLE.rows
    ]
    assert f"lowest error in {number} of these" in motion_peers.motion_peers({"motion_peers": TABLE._replace(rows=rows)})


@pytest.mark.full
def test_all_libraries_answer_with_all_sets_of_cameras():
    sets = [{row[1].split()[0] for row in TABLE.select(cameras=cameras)} for cameras in set(TABLE.column("cameras"))]
    assert sets == [{"anipose", "Pose2Sim", "EKS", "poseppl"}] * 3
