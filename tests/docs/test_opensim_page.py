"""The page of OpenSim's coordinates lists those that are written."""

from __future__ import annotations

from pathlib import Path

import pytest
from poseppl_models.bodies.footed import footed_body

from poseppl.motion.bodies.opensim import opensim_coordinates

pytestmark = pytest.mark.full

PAGE = Path(__file__).resolve().parents[2] / "docs" / "opensim.md"


def test_the_table_of_coordinates() -> None:
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| `") and line.count("|") == 5]
    expected = [
        f"| `{each.name}` | {each.meaning} | {each.unit} | {', '.join(f'`{joint}`' for joint in each.joints)} |"
        for each in opensim_coordinates(footed_body())
    ]
    assert rows == expected
