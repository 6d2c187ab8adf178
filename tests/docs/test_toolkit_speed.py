"""The page's statements about the toolkit's speed follow from the table."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts.toolkit_speed import beside_rivals, first_results


def test_ratios_are_held_against_their_goals() -> None:
    columns = ("job", "rival", "seconds", "rival_seconds", "goal")
    rows = [
        ("bootstrap", "by hand", 0.03, 0.01, 1.5),
        ("Viterbi", "both ways", 0.5, 1.0, 2.0),
        ("batch", "loop", 0.1, 1.0, 0.0),
    ]
    found = beside_rivals({"toolkit_speed": Table("toolkit_speed", columns, rows)}).splitlines()
    assert found[2] == "| bootstrap | 30.0 | by hand | 10.0 | 3.00 |"
    assert found[-1] == "bootstrap, at most 1.5 times: does not hold; Viterbi, at most 2 times: holds."


@pytest.mark.full
def test_first_results_are_held_against_their_goals() -> None:
    columns = ("first", "second", "first_result", "second_filter", "again")
    rows = [("particle", "kalman", 1.5, 0.5, 0.02), ("kalman", "particle", 0.5, 1.5, 0.02)]
    found = first_results({"first_results": Table("first_results", columns, rows)}).splitlines()
    assert found[2] == "| particle | 1.50 | kalman | 0.50 | 0.02 |"
    assert found[-1].endswith("seconds: holds. A second filter's in at most 1: does not hold (particle after kalman).")
