"""Smoothing with Darby's motion: gains over people, and particles that a filter left."""

from __future__ import annotations

import pytest
from poseppl_papers.darby.smoothed import gains, smoothing_pays
from poseppl_papers.tables import Table

pytestmark = pytest.mark.full

COLUMNS = ("system", "person", "scene", "method", "run", "filter", "forward_backward", "backward_simulation", "ess_share")
ROWS = [
    ("guided", "07", "walk", "APF", 0, 40.0, 30.0, 40.0, 0.3),
    ("guided", "07", "walk", "APF", 1, 60.0, 50.0, 60.0, 0.5),  # together 20 % less, and none
    ("guided", "08", "walk", "APF", 0, 50.0, 40.4, 60.0, 0.4),
    ("guided", "08", "walk", "APF", 1, 50.0, 40.4, 60.0, 0.4),  # 19.2 % less, and 20 % more
]


def test_gains_are_of_peoples_means_over_runs():
    table = Table("smoothing", COLUMNS, ROWS, "")
    gain, loss = (gains(table.records(), name) for name in ("forward-backward", "backward-simulation"))
    assert gain.mean == pytest.approx(19.6) and loss.mean == pytest.approx(-10.0)
    reach = 12.706 * 0.4  # Student's with one degree of freedom; half of the difference between people
    assert gain.high - gain.mean == pytest.approx(reach, rel=1e-3)


def test_the_page_has_a_verdict_for_each_smoother():
    said = smoothing_pays({"smoothing": Table("smoothing", COLUMNS, ROWS, "")})
    row = said.splitlines()[-1]
    assert "| 2 | 4 | 50 |" in row.replace("50 (50 to 50)", "50")
    assert "20 (15 to 25): holds" in row and "-10 (-137 to 117): undecided" in row and "| 0.40 |" in row
    assert smoothing_pays({}) == ""
