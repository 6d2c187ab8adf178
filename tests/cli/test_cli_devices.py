"""`poseppl track --set devices=N`."""

from __future__ import annotations

import os
import subprocess
import sys

import jax
import numpy as np
import pytest
from waiting import PATIENCE

from poseppl.cli import main
from poseppl.runs.results import load_result, provenance

pytestmark = pytest.mark.full

MAIN = "import sys; from poseppl.cli import main; sys.exit(main())"
TRACK = ["track", "--frames", "0:3", "--max-draws", "20", "--quiet"]
FILTERS = {
    "particle": ["--filter", "particle", "--set", "num_particles=200"],
    "assumed-density": ["--filter", "assumed-density", "--set", "num_chains=10"],
}


@pytest.fixture(autouse=True)
def _processors(here, monkeypatch):
    monkeypatch.setenv("NPROC", "18")  # as the command sets it; here it is put back afterwards


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        ("3", "--set devices: 3 devices cannot share 200 particles (expected a number that divides the 200 particles)"),
        ("8", f"--set devices: devices is 8, but JAX has {len(jax.devices())} here"),
    ],
)
def test_devices_that_cannot_be_used(capsys, tmp_path, devices, message):
    assert main([*TRACK, *FILTERS["particle"], "--set", f"devices={devices}"]) == 1
    assert capsys.readouterr().err.startswith(f"poseppl: {message}")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="the machine has one core")
@pytest.mark.parametrize("name", FILTERS)
def test_two_devices_give_what_one_gives(name):
    for number in ("1", "2"):
        command = [sys.executable, "-c", MAIN, *TRACK, *FILTERS[name], "--set", f"devices={number}", "--output", f"{number}.nc"]
        environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
        del environment["NPROC"]
        subprocess.run(command, check=True, timeout=PATIENCE, env=environment)
    one, two = load_result("1.nc"), load_result("2.nc")
    assert [provenance(tree)["devices"] for tree in (one, two)] == [1, 2]
    first = [tree["summary/state_mean"].isel(frame=0) for tree in (one, two)]  # later, float32 may decide otherwise
    np.testing.assert_allclose(*first, rtol=1e-4, atol=1e-3)
