"""Loops over few bytes are one function each for the command line, unless the environment tells a limit."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from waiting import PATIENCE

from poseppl.small_loops import as_functions

LIMIT = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold"
OURS = f"{LIMIT}=1000000"
LOOP = """
import poseppl.cli
assert poseppl.cli.main(["filters", "kalman"]) == 0
import jax, jax.numpy as jnp

loop = jax.jit(lambda x: jax.lax.fori_loop(0, 9, lambda i, y: jnp.cumsum(jnp.sin(y)), x))
print("calls", loop.lower(jnp.ones(1000)).compile().as_text().count("xla_cpu_small_call"))
"""


@pytest.mark.full
@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("", OURS),
        ("--xla_dump_to=here", f"--xla_dump_to=here {OURS}"),
        (
            "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling",
            f"--xla_backend_extra_options=xla_cpu_disable_loop_unrolling {OURS}",
        ),
        (f"{LIMIT}=0 --xla_dump_to=here", f"{LIMIT}=0 --xla_dump_to=here"),
        ("flags.txt", "flags.txt"),
    ],
)
def test_flags_of_the_user_stay(given: str, found: str) -> None:
    assert as_functions({"XLA_FLAGS": given}) == as_functions(as_functions({"XLA_FLAGS": given})) == {"XLA_FLAGS": found}
    assert as_functions({}) == {"XLA_FLAGS": OURS}


@pytest.mark.full
@pytest.mark.parametrize(
    ("given", "calls"), [("", 1), ("--xla_backend_extra_options=xla_cpu_disable_loop_unrolling", 1), (f"{LIMIT}=0", 0)]
)
def test_the_command_line_sets_them_before_jax_reads_them(given: str, calls: int) -> None:
    environment = os.environ | {"XLA_FLAGS": given, "JAX_PLATFORMS": "cpu", "JAX_ENABLE_COMPILATION_CACHE": "0"}
    told = subprocess.run(
        [sys.executable, "-c", LOOP], check=True, capture_output=True, text=True, timeout=PATIENCE, env=environment
    )
    assert told.stdout.split("calls ")[1] == f"{calls}\n"
