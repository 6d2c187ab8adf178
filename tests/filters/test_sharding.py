"""Filters on four devices give what they give on one; a CPU is made into four of them, in a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import jax
import pytest
from catalogue import FILTERS
from law_problems import problem
from waiting import PATIENCE

from poseppl.filters import particle_filter, sharded

REPORT = Path(__file__).with_name("sharding_report.py")
ROUNDING = 1e-11
"""A thousand times what differs after four frames where chains are short, and far below one decision taken the other way."""
AMPLIFIED = 10.0
"""Times the distance to particles of data rounded otherwise in the last bit: long chains amplify that ten thousandfold."""
QUICK = ("particle", "hmc", "driver")
SLOW = ("guided", "tempered", "assumed-density", "demc-posterior", "unscented")


@cache
def finished(names):
    environment = {
        **os.environ,
        "XLA_FLAGS": "--xla_force_host_platform_device_count=4",
        "JAX_ENABLE_X64": "1",
        "JAX_DISABLE_MOST_OPTIMIZATIONS": "1",
        "JAX_PLATFORMS": "cpu",
        "NPROC": "34",
        "PYTHONWARNINGS": "error",
    }
    return subprocess.run(
        [sys.executable, str(REPORT), *names], check=False, capture_output=True, text=True, timeout=PATIENCE, env=environment
    )


def report(names):
    done = finished(names)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def names_of(names):
    return [pytest.param(name, QUICK) for name in QUICK if name in names] + [
        pytest.param(name, SLOW, marks=pytest.mark.slow) for name in SLOW if name in names
    ]


@pytest.mark.full
@pytest.mark.parametrize(("name", "group"), names_of({row.name for row in FILTERS}))
def test_four_devices_give_what_one_gives(name, group):
    found = report(group)[name]
    assert found["dtype"] == "float64"
    bound = max(ROUNDING, AMPLIFIED * found["rounded"])
    assert bound < 1e-8 and max(found["particles"], found["log_weights"], found["evidence"]) < bound


@pytest.mark.full
@pytest.mark.parametrize(("name", "group"), names_of({row.name for row in FILTERS}))
def test_each_device_has_its_quarter_of_the_particles_and_of_the_work(name, group):
    found = report(group)[name]
    quarter = found["rows"] // 4
    rows = [str(slice(index * quarter, (index + 1) * quarter)) for index in range(4)]
    assert all(sorted(frame) == sorted(rows) for frame in found["four"])
    assert all(len(frame) == 1 for frame in found["one"])
    if name != "assumed-density":  # there every device climbs to the modes, and then moves its own chains
        assert found["work"] < 0.26


@pytest.mark.full
def test_the_driver_compiles_once_and_resumes_to_the_last_bit():
    found = report(QUICK)["driver"]
    assert found["distance"] < ROUNDING and found["resumed"] == 0.0 and found["compiled"] == 1


@pytest.mark.full
def test_particles_that_cannot_be_shared_evenly_are_refused():
    assert report(QUICK)["driver"]["refused"] == "10 particles or chains cannot be shared evenly among 4 devices"


@pytest.mark.full
def test_one_device_is_allowed():
    posed = problem()
    built = sharded(particle_filter(posed.model, 10), jax.devices()[:1])
    seen, inputs = jax.tree.map(lambda leaf: leaf[0], (posed.observations, posed.inputs))
    state, _ = jax.jit(built.init)(jax.random.key(0), seen, inputs)
    assert state.particles.devices() == set(jax.devices()[:1])


@pytest.mark.full
def test_what_is_refused():
    posed = problem()
    built = particle_filter(posed.model, 10)
    for number in (0, len(jax.devices()) + 1):
        with pytest.raises(ValueError, match=rf"devices is {number}, but JAX has .*--xla_force_host_platform_device_count="):
            sharded(built, number)
    with pytest.raises(ValueError, match="devices is empty"):
        sharded(built, [])
