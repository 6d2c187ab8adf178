"""The laws of exactness once more, in a process whose arrays are of double precision throughout."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LAWS = Path(__file__).resolve().parent


@pytest.mark.slow
@pytest.mark.parametrize("file", ["test_exactness.py", "test_smoothing_exactness.py"])
def test_filters_and_smoothers_are_exact_in_double_precision(file):
    words = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:randomly", str(LAWS / file)]
    done = subprocess.run(words, env={**os.environ, "JAX_ENABLE_X64": "1"}, cwd=LAWS.parents[1], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:]
