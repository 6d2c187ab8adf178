"""The cameras tutorial: its commands run on the demo, and its figures are about those that it states."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from poseppl.cli import main
from poseppl.motion.io.trc import read_trc

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "cameras.md"


@pytest.mark.slow
def test_the_demo_is_tracked(here: None) -> None:
    text = PAGE.read_text()
    for command in re.findall(r"^    poseppl (.*(?:\n        .*)*)", text, re.MULTILINE):
        assert main([*command.split(), "-q"]) == 0, command
    truth = read_trc("walk/truth.trc", up="y").positions
    mean, lower, upper = (read_trc(f"walk-laplace{end}.trc", up="y").positions for end in ("", "_lower", "_upper"))
    error = np.linalg.norm(mean - truth, axis=-1)
    low, high = np.minimum(lower, upper), np.maximum(lower, upper)
    covered = 100 * np.mean((low <= truth) & (truth <= high))
    told = [float(value) for value in re.findall(r"about (\d+)", text)]
    found = [np.median(error), np.quantile(error, 0.95), covered]
    np.testing.assert_allclose(found, told, atol=1.5)  # the same seed; rounding, and other versions' random numbers
    assert Path("walk-laplace_gait.html").is_file()
