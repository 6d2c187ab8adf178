"""Remedies are data: an argument in Python, an option on the command line. Checks of a body are made where there is one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic import synthetic_result

from poseppl.cli import main
from poseppl.cli.console import print_verdict
from poseppl.cli.options import as_option
from poseppl.diagnostics import Remedy, Verdict, diagnose, verdicts
from poseppl.diagnostics.diagnosis import EXTENSIONS
from poseppl.diagnostics.verdicts import CHECKS, checks_of
from poseppl.motion.verdicts import CHECKS as OF_BODIES
from poseppl.report import report_html
from poseppl.runs.results import Names, build_result, save_result

WRONG = diagnose(synthetic_result(num_frames=12, num_draws=20, truth_scale=2.5))
"""Overconfident, of a filter with the settings num_chains and num_updates."""


def test_a_remedy_is_an_argument_in_python_and_an_option_of_the_command_line() -> None:
    remedies = (
        Remedy("use {}", "walk", "learned"),
        Remedy("raise {}", "sigma_angle"),
        Remedy("raise {}", "num_chains", setting=True),
        Remedy("use {}", "target", "posterior", setting=True),
        Remedy("add a camera"),
    )
    found = Verdict("warning", "Too narrow:", remedies)
    assert found.text == (
        "Too narrow: use walk='learned', raise sigma_angle or num_chains, use target='posterior', or add a camera."
    )
    assert found.worded(as_option) == (
        "Too narrow: use --walk learned, raise --set sigma_angle or --set num_chains, use --set target=posterior, "
        "or add a camera."
    )
    assert Verdict("info", "Right.").worded(as_option) == "Right." and str(found) == f"warning: {found.text}"
    assert Verdict("info", "Few;", remedies[:1]).text == "Few; use walk='learned'."


PYTHON, OPTIONS = "raise noise, sigma_angle", "raise --noise, --set sigma_angle"


def test_the_command_names_options(capsys: pytest.CaptureFixture[str]) -> None:
    print_verdict(WRONG, Path("run.nc"), quiet=False)
    assert OPTIONS in capsys.readouterr().out and PYTHON in str(verdicts(WRONG)[0])


@pytest.mark.full
def test_the_report_of_the_command_names_options(tmp_path: Path) -> None:
    save_result(WRONG, tmp_path / "run.nc")
    assert main(["report", str(tmp_path / "run.nc")]) == 0
    of_command, of_python = (tmp_path / "run.html").read_text(), report_html(WRONG)
    assert OPTIONS in of_command and PYTHON not in of_command and PYTHON in of_python and OPTIONS not in of_python


def test_a_body_has_further_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """They come with those of any result, causes before effects; without the extension the others remain."""
    level = build_result(state=np.zeros((1, 2, 3, 1)), names=Names(("level",)))
    assert checks_of(level) is CHECKS and checks_of(WRONG) is OF_BODIES and set(CHECKS) < set(OF_BODIES)
    order = list(OF_BODIES)
    assert order.index("number of chains") < order.index("steps") < order.index("residuals of points") < order.index("mixing")
    assert any("intervals of joints" in found.text for found in verdicts(WRONG))
    monkeypatch.delitem(EXTENSIONS, "body")
    found = verdicts(WRONG)
    assert found[0].text.endswith("intervals are too narrow: raise num_updates.") and "joints" not in "".join(map(str, found))


def test_a_file_chooses_no_code() -> None:
    """Extensions are those of the table, whatever a result's attributes say."""
    tree = build_result(state=np.zeros((1, 2, 3, 1)), names=Names(("level",)), attrs={"body": "os", "extension": "os"})
    assert checks_of(tree) is CHECKS and list(EXTENSIONS.values()) == ["poseppl.motion"]
