"""How a whole program is compiled, by how much it will compute.

XLA's fusion emitters for the CPU take a third of the time that compilation takes, and whole runs are no faster for them
(`python benchmarks/fusion_emitters.py`). A bare loop over 100,000 particles is, by half of its time (`python
benchmarks/filters.py --quick`, with and without `XLA_FLAGS=--xla_cpu_use_fusion_emitters=false`): programs of many particles
keep them.

>>> lowered = jax.jit(lambda x: 2 * x).lower(1.5)
>>> float(compile_lowered(lowered, num_particles=100)(1.5))
3.0
"""

from __future__ import annotations

from typing import Any

import jax

MOST_PARTICLES = 1000
"""Of programs that are compiled without the emitters."""
_WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}


def compile_lowered(lowered: Any, num_particles: int) -> Any:
    """The program of `jax.jit(...).lower(...)`, ready to run; an XLA that does not know the emitters compiles as it does."""
    if num_particles > MOST_PARTICLES:
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=_WITHOUT_EMITTERS)
    except jax.errors.JaxRuntimeError:
        return lowered.compile()
