"""The last line of a run: its worst verdict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_result

from poseppl.cli.console import print_verdict, print_verdicts
from poseppl.diagnostics import diagnose


def printed(capsys: pytest.CaptureFixture[str], *, quiet: bool, **arguments: object) -> tuple[str, str]:
    print_verdict(diagnose(synthetic_result(num_frames=60, **arguments)), Path("run.nc"), quiet)  # type: ignore[arg-type]
    return tuple(capsys.readouterr())  # type: ignore[return-value]


@pytest.mark.full
def test_the_worst_verdict_is_printed_and_the_others_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    failed, acceptance = np.zeros(60, bool), np.full(60, 0.85)
    failed[2], acceptance[20] = True, 0.01
    wrong = {"sample_stats": {"failed": failed, "acceptance_rate": acceptance}}
    line = "error: Data with zero likelihood in frame 12: no draw explains them, and the posterior there is the prediction."
    more = " 1 more in the report: poseppl report run.nc\n"
    assert printed(capsys, quiet=False, **wrong) == (line + more, "")
    assert printed(capsys, quiet=True, **wrong) == ("", f"poseppl: {line}{more}")


NO_PROBLEMS = (
    "info: No problems detected by 8 of 12 checks. Not run: predictions, weakly informed coordinates, updates (no predictive "
    "checks); forecasts (no hindcasts).\n"
)


@pytest.mark.full
def test_a_good_run_is_reported_unless_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, quiet=False) == (NO_PROBLEMS, "")
    assert printed(capsys, quiet=True) == ("", "")


def test_each_of_two_results_that_were_written_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    """An error of the smoothed one is not hidden by a filter that is right."""
    failed = np.zeros(60, bool)
    failed[2] = True
    right, wrong = (synthetic_result(num_frames=60, sample_stats=stats) for stats in (None, {"failed": failed}))
    print_verdicts({Path("run.nc"): right, Path("run-laplace.nc"): wrong}, quiet=False)
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("run.nc: info: No problems") and second.startswith(
        "run-laplace.nc: error: Data with zero likelihood in frame 12"
    )
