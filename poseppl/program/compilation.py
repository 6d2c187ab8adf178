"""How a whole program is compiled, by how much it will compute.

XLA's fusion emitters for the CPU take a third or more of the time that compilation takes, and whole runs on a body of 28
coordinates are no faster for them, of up to 10,000 particles (`python benchmarks/fusion_emitters.py`). A bare loop over 100,000
particles is, by half of its time (`python benchmarks/filters.py --quick`, with and without
`XLA_FLAGS=--xla_cpu_use_fusion_emitters=false`). So programs of many particles keep them, and small states from fewer on.

>>> lowered = jax.jit(lambda x: 2 * x).lower(1.5)
>>> float(compile_lowered(lowered, num_particles=100, dimension=1)(1.5))
3.0
"""

from __future__ import annotations

from typing import Any

import jax

MOST_PARTICLES = {1: 1_000, 20: 10_000}
"""Of programs that are compiled without the emitters, by the least dimension of a state that it holds for."""
_WITHOUT_EMITTERS = {"xla_cpu_use_fusion_emitters": False}


def compile_lowered(lowered: Any, num_particles: int, dimension: int = 1) -> Any:
    """The program of `jax.jit(...).lower(...)`, ready to run; an XLA that does not know the emitters compiles as it does."""
    if num_particles > max((most for least, most in MOST_PARTICLES.items() if dimension >= least), default=0):
        return lowered.compile()
    try:
        return lowered.compile(compiler_options=_WITHOUT_EMITTERS)
    except jax.errors.JaxRuntimeError:
        return lowered.compile()
