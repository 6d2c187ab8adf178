"""The page's statements about compilation follow from the runs."""

from __future__ import annotations

import pytest
from poseppl_papers.tables import Table

from studies.verdicts.compile_times import compile_times

pytestmark = pytest.mark.full

COLUMNS = ("kind", "name", "settings", "compilation", "run", "memory")


@pytest.mark.parametrize(
    ("seconds", "told"),
    [
        (20.5, "each: does not hold, 1 of 2 filters take more; 0 of 1 smoothers take more."),
        (19.5, "each: holds, 0 of 2 filters take more; 0 of 1 smoothers take more."),
    ],
)
def test_those_that_compile_longer_are_counted(seconds: float, told: str) -> None:
    rows = [
        ("none", "", "", 0.0, 0.0, 350.0),
        ("filter", "hmc", "", seconds, 0.25, 1500.0),
        ("filter", "guided", "prior", 3.0, 1.0, 2000.0),
        ("smoother", "viterbi", "", 5.0, 0.5, 500.0),
    ]
    found = compile_times({"compile_times": Table("compile_times", COLUMNS, rows)}).splitlines()
    assert found[-1].endswith(told) and "uses 350 MiB" in found[-1]
    assert found[3] == "| filter guided, prior | 3.0 | 1.0 | 2,000 |"
