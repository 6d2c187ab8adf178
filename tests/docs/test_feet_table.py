"""The guide's table of feet and head is the committed one."""

from __future__ import annotations

import csv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_table_of_feet() -> None:
    with (ROOT / "studies" / "tables" / "feet.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    text = (ROOT / "docs" / "keypoints.md").read_text()
    for row in rows:
        errors = [f"{float(row[name]):.0f}" for name in ("median", "percentile_95")]
        shares = [f"{100 * float(row[name]):.0f} %" for name in ("coverage_50", "coverage_90")]
        assert f"| {' | '.join([row['detector'], row['markers'], *errors, *shares])} |" in text
    assert len(rows) == 6
