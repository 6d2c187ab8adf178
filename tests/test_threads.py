"""More threads for JAX than cores, so that batches of linear algebra never wait for themselves."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from waiting import PATIENCE

BATCHES = """
import poseppl  # without this line, or with NPROC=2, the program never ends on two cores
import jax, jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

@jax.jit
def halves(lower):
    for _ in range(10):
        both = [jnp.sin(solve_triangular(half, jnp.broadcast_to(jnp.eye(24), half.shape), lower=True)) for half in lower]
        lower = [jnp.tril(half) + 4 * jnp.eye(24) for half in both]
    return sum(half.sum() for half in lower)

lower = [jnp.tril(jnp.ones((64, 24, 24))) + k * jnp.eye(24) for k in range(1, 5)]
for _ in range(10):
    halves(lower).block_until_ready()
"""


def threads(environment, code="import poseppl, os; print(os.environ['NPROC'])"):
    clean = {name: value for name, value in os.environ.items() if name != "NPROC"}
    return subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=PATIENCE, env={**clean, **environment}
    ).stdout.strip()


@pytest.mark.full
def test_the_environment_is_kept_where_it_says_how_many():
    cores = os.cpu_count() or 1
    assert threads({}) == str(cores + 16)
    assert threads({"NPROC": "3"}) == "3"
    more = "import poseppl, os; from poseppl.threads import spare_threads; spare_threads(4); print(os.environ['NPROC'])"
    assert threads({}, more) == str(cores + 40) and threads({"NPROC": "3"}, more) == "3"


@pytest.mark.full
def test_batches_that_wait_at_once_come_to_an_end():
    clean = {name: value for name, value in os.environ.items() if name != "NPROC"}
    subprocess.run([sys.executable, "-c", BATCHES], check=True, timeout=PATIENCE, env=clean)
